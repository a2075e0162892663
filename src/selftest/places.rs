//! The same scene at other scales, in other places and turned: what does not change must not.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::images::{
    AT_UNIT_SIZE, Algorithm, FURNACE_RADIANCE, INTEGRATORS, Rendered, furnace, image, images, integrator,
    mean_and_error, moved, room,
};
use super::{Bench, Effort, Finding, Group, SelftestError};
use crate::scene::Scene;

/// Pixels along a side of images that are compared with the same paths elsewhere.
pub(super) const PAIRED_SIZE: u32 = 16;

/// Passes of those.
const PAIRED_PASSES: u32 = 16;

/// By how much means over two images differ, relative to the first.
pub(super) fn difference(a: &Rendered, b: &Rendered) -> f64 {
    ((b.mean() - a.mean()) / a.mean()).abs()
}

/// Renders a scene in two forms by the same random numbers with each integrator; a finding for each by `measure`.
pub(super) fn paired(
    bench: &Bench,
    group: Group,
    algorithms: &[Algorithm],
    forms: [&Scene; 2],
    (check, limit): (&str, Option<f64>),
    measure: impl Fn(&Rendered, &Rendered) -> f64,
) -> Result<Vec<Finding>, SelftestError> {
    let finding = |&(label, parameters): &Algorithm| {
        let algorithm = integrator(label, parameters)?;
        let [a, b] = forms.map(|scene| image(bench, scene, algorithm, PAIRED_PASSES));
        let measured = measure(&a?, &b?);
        Ok(Finding { integrator: label, ..bench.finding(group, check, measured, limit) })
    };
    algorithms.iter().map(finding).collect()
}

/// Everything by a factor, point lights by its square: radiance stays.
///
/// A power of two changes no digit of any number, so the images must be equal to the last bit: one value that differs is a constant with a unit hidden somewhere. Other factors round every vertex anew. A
/// path whose edge falls on the other side of something by it becomes another path; of 4096 samples some do, and since a path is worth some 1/4000 of the mean, a
/// few of them are the limit of 2e-3. An epsilon in world units shows as tens of percents here.
pub(super) fn check_scale(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let unit = room(PAIRED_SIZE)?;
    let mut findings = Vec::new();
    let scaled = |scale: f64| moved(unit.clone(), &DAffine3::from_scale(DVec3::splat(scale)));
    for (name, scale) in [("2^-20", 2f64.powi(-20)), ("2^20", 2f64.powi(20))] {
        let check = format!("room x {name}: share of values that change a bit");
        let measure = |a: &Rendered, b: &Rendered| b.share_that_differs(a, 1.0);
        findings.extend(paired(
            bench,
            Group::Scale,
            &INTEGRATORS,
            [&unit, &scaled(scale)?],
            (&check, Some(0.0)),
            measure,
        )?);
    }
    for (name, scale) in [("1e-6", 1e-6), ("1e-3", 1e-3), ("1e3", 1e3), ("1e6", 1e6)] {
        let check = format!("room x {name}: relative difference of the mean");
        findings.extend(paired(
            bench,
            Group::Scale,
            &INTEGRATORS,
            [&unit, &scaled(scale)?],
            (&check, Some(2e-3)),
            difference,
        )?);
    }
    Ok(findings)
}

/// The room far from the origin against the same shape at the origin: that which its vertices have *after* they were rounded far away, so that what is measured is
/// transport alone.
///
/// At 128 sizes the limit is that of other scales. Rays start up to 22 roundings of a coordinate off a surface, since that is what can go wrong in a
/// plane test; at 1024 sizes these are 0.3 % of the room, contact shadows and corners lose so much, and the limit is 1 % of the mean. From 1700 sizes on the loader warns. At 16,384 sizes the limit is what the
/// table of limits says, a tenth; at a million nothing is left of the shape, which is reported.
pub(super) fn check_place(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let unit = room(PAIRED_SIZE)?;
    let mut findings = Vec::new();
    for (name, exponent, limit) in
        [("128", 8, Some(2e-3)), ("1024", 11, Some(1e-2)), ("16384", 15, Some(0.1)), ("1048576", 21, None)]
    {
        // The room is 2 wide. An offset of few bits is added and taken away exactly.
        let offset = DVec3::new(1.0, -0.75, 0.5) * 2f64.powi(exponent);
        let mut far = moved(unit.clone(), &DAffine3::from_translation(offset))?;
        let position = &mut far.camera.to_world.translation;
        *position = position.as_vec3().as_dvec3();
        let near = moved(far.clone(), &DAffine3::from_translation(-offset))?;
        let check = format!("room {name} sizes away: relative difference of the mean");
        findings.extend(paired(
            bench,
            Group::Place,
            &AT_UNIT_SIZE,
            [&near, &far],
            (&check, limit),
            difference,
        )?);
    }
    Ok(findings)
}

/// Name, passes, parameters, whether edges are dark, whether it reaches flat and long boxes.
type FurnaceCase = (&'static str, u32, &'static [(&'static str, &'static str)], bool, bool);

/// What is lost along the edges of the box that is stretched to 1e4 and turned: the camera is 1000 from the origin, where a ray may start 22 roundings, 0.0013,
/// off its surface, and what starts beside an edge is outside; three times that share of the half width of 1, since parts of the box are farther away. The table of limits
/// has what was measured.
const EDGE_LOSS: f64 = 3.0 * 22.0 * 1000.0 / (1u64 << 24) as f64;

/// Turned by odd angles, mirrored, and squeezed to 1 : 1e4, each against the closed form: inside a closed surface that glows and reflects diffusely, radiance is the same
/// everywhere, whatever its shape.
///
/// 64 independent images give a mean and its error; the limit is 5.5 errors, which chance exceeds with a probability below 1e-6 (Student's t with 63 degrees of freedom), and a
/// check with an error above 0.5 % is void. The stretched box is allowed [`EDGE_LOSS`] more. The photon maps' radiance is too low along edges by design (their disc reaches
/// over them), so they are held against the same box seen in the same way before it was turned; and not at 1 : 1e4, where the disc is wider than the box is high. Nor is `ptracer`:
/// of its paths one in 1e8 ends where the camera looks.
pub(super) fn check_orientation(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let turned = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 1.1, -0.4, 2.7));
    let mirrored = turned * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
    let cases = [
        ("turned", turned, true, 0.0),
        ("turned and mirrored", mirrored, true, 0.0),
        ("squeezed to 1 : 1e4", DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1e-4)), false, 0.0),
        (
            "turned, stretched 1e4 : 1",
            turned * DMat3::from_diagonal(DVec3::new(1e4, 1.0, 1.0)),
            false,
            EDGE_LOSS,
        ),
    ];
    let more = if bench.effort == Effort::Quick { 1 } else { 16 };
    let estimate = |matrix: DMat3, is_rotation: bool, (name, passes, parameters): (&str, u32, &[_])| {
        let scene = furnace(&DAffine3::from_mat3(matrix), is_rotation, PAIRED_SIZE)?;
        let algorithm = integrator(name, parameters)?;
        Ok::<_, SelftestError>(mean_and_error(&images(bench, &scene, algorithm, 0..64, more * passes)?))
    };
    // Passes for an error below half a percent; and whether edges are dark, and whether the integrator reaches flat and long boxes.
    let algorithms: [FurnaceCase; 6] = [
        ("path", 1, &[], false, true),
        ("ptracer", 16, &[], false, false),
        ("bdpt", 1, &[], false, true),
        ("photonmapper", 2, &[("photons", "4000"), ("lookup", "knn"), ("k", "30")], true, false),
        ("sppm", 4, &[("photons", "4000"), ("radius", "0.1")], true, false),
        ("vpl", 4, &[("count", "10")], false, true),
    ];
    let mut findings = Vec::new();
    for (label, passes, parameters, has_dark_edges, reaches_all) in algorithms {
        let algorithm = (label, passes, parameters);
        let reference = if has_dark_edges {
            estimate(DMat3::IDENTITY, true, algorithm)?
        } else {
            (FURNACE_RADIANCE, 0.0)
        };
        for (which, matrix, is_rotation, loss) in cases {
            if !(is_rotation || reaches_all) {
                continue;
            }
            let (mean, error) = estimate(matrix, is_rotation, algorithm)?;
            let error = error.hypot(reference.1) / reference.0;
            let check = format!("glowing box {which}: relative error of its radiance");
            let measured = if error > 0.005 { f64::NAN } else { (mean / reference.0 - 1.0).abs() };
            // The rounding of some ten operations on each of some ten bounces.
            let limit = 5.5 * error + 1e-5 + loss;
            let finding = bench.finding(Group::Orientation, check, measured, limit);
            findings.push(Finding { integrator: label, ..finding });
        }
    }
    Ok(findings)
}
