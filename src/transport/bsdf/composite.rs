//! Materials that are made of others: masks, blends and perturbed normals; and the one that is too large to be kept
//! prepared. They hold a reference to the material, and prepare what they need each time they are asked, so that
//! scenes without them pay nothing for them. Sees `wo` with `wo.z` > 0.

use glam::{Vec2, Vec3};

use super::materials::Materials;
use super::principled::PrincipledLobe;
use super::{BsdfSample, Frame, Lobe, TransportMode};
use crate::scene::{Input, Material, MaterialId, Perturbation, Place, Rgb, SurfacePoint, Textures};

/// A material at a point, not yet prepared.
#[derive(Clone, Copy)]
pub(super) struct Composite<'s> {
    materials: &'s Materials<'s>,
    id: MaterialId,
    uv: Vec2,
    /// The derivatives of the position: (x, 0) by u and (y, z) by v in the shading frame, whose x is along the first. Only set
    /// where bumps need them.
    tangents: Vec3,
    /// Seen from the side that the shading normal points to.
    is_above: bool,
}

/// What a composite is made of.
enum Parts<'s> {
    Principled(PrincipledLobe),
    /// Two lobes and the fraction of the second.
    Blend([Lobe<'s>; 2], f32),
    Perturbed(Lobe<'s>, Perturbed),
}

impl std::fmt::Debug for Composite<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} at {}", self.materials.get(self.id), self.uv)
    }
}

impl<'s> Composite<'s> {
    /// The material at a point. Tangents are looked up for bumps only.
    #[inline(never)]
    pub(super) fn new(
        materials: &'s Materials<'s>,
        id: MaterialId,
        point: &SurfacePoint,
        is_above: bool,
    ) -> Self {
        let tangents = if is_bumpy(materials, id) { tangents(materials, point) } else { Vec3::ZERO };
        Self { materials, id, uv: point.uv, tangents, is_above }
    }

    /// The same as seen from the other side, if light gets there.
    pub(super) fn turned_over(&self) -> Option<Self> {
        self.materials.traits(self.id).transmits.then_some(Self { is_above: !self.is_above, ..*self })
    }

    pub(super) fn is_delta(&self) -> bool {
        self.materials.traits(self.id).is_delta
    }

    /// A material that this one is made of; nothing, unless it comes before in the scene.
    fn part(&self, id: MaterialId) -> Lobe<'s> {
        if id.0 >= self.id.0 {
            return Lobe::Black;
        }
        let nested = |id, is_above| Self { id, is_above, ..*self };
        Lobe::new(self.materials, id, self.place(), self.is_above, nested)
    }

    /// Where textures are evaluated. Composites do not keep the point, so that loaders give them no attributes of meshes.
    fn place(&self) -> Place<'static> {
        Place { uv: self.uv, point: None }
    }

    fn parts(&self) -> Option<Parts<'s>> {
        let textures = Textures::of(self.materials.scene);
        let fraction = |input: Input<f32>| input.at(textures, self.place()).clamp(0.0, 1.0);
        Some(match self.materials.get(self.id)? {
            Material::Principled(p) => {
                Parts::Principled(PrincipledLobe::new(p, textures, self.place(), self.is_above))
            }
            &Material::Mask { opacity, material } => {
                Parts::Blend([Lobe::Null, self.part(material)], fraction(opacity))
            }
            &Material::Blend { weight, first, second } => {
                Parts::Blend([self.part(first), self.part(second)], fraction(weight))
            }
            &Material::Perturbed { by, flip_invalid_normals, use_shadowing_function, material } => {
                let normal = self.normal(by, textures);
                let shadowing = use_shadowing_function;
                Parts::Perturbed(
                    self.part(material),
                    Perturbed { normal, flips: flip_invalid_normals, shadowing },
                )
            }
            _ => return None,
        })
    }

    /// The perturbed normal in the frame of the side that is looked at.
    fn normal(&self, by: Perturbation, textures: Textures) -> Vec3 {
        let n = match by {
            Perturbation::Normal(input) => input.at(textures, self.place()) * 2.0 - 1.0,
            Perturbation::Bump { texture, scale } => {
                let slope = textures.slope(texture, self.uv) * scale;
                let [a, b, c] = self.tangents.to_array();
                let n = Vec3::new(a, 0.0, slope.x).cross(Vec3::new(b, c, slope.y));
                if n.z < 0.0 { -n } else { n }
            }
        };
        let n = n.try_normalize().unwrap_or(Vec3::Z);
        if self.is_above { n } else { mirrored(n) }
    }

    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, u: [f32; 3], mode: TransportMode) -> Option<BsdfSample> {
        match self.parts()? {
            Parts::Principled(lobe) => lobe.sample(wo, u[0], Vec2::new(u[1], u[2]), mode),
            Parts::Blend(lobes, weight) => sample_blend(&lobes, weight, wo, u, mode),
            Parts::Perturbed(lobe, perturbed) => perturbed.sample(&lobe, wo, u, mode),
        }
    }

    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        match self.parts() {
            Some(Parts::Principled(lobe)) => lobe.eval(wo, wi, mode),
            Some(Parts::Blend([a, b], w)) => {
                let value =
                    |lobe: &Lobe, w: f32| if w > 0.0 { lobe.eval(wo, wi, mode) * w } else { Rgb::ZERO };
                value(&a, 1.0 - w) + value(&b, w)
            }
            Some(Parts::Perturbed(lobe, perturbed)) => perturbed.eval(&lobe, wo, wi, mode),
            None => Rgb::ZERO,
        }
    }

    #[inline(never)]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
        match self.parts() {
            Some(Parts::Principled(lobe)) => lobe.pdf(wo, wi),
            Some(Parts::Blend(lobes, w)) => blend_pdf(&lobes, w, wo, wi, mode),
            Some(Parts::Perturbed(lobe, perturbed)) => perturbed.pdf(&lobe, wo, wi, mode),
            None => 0.0,
        }
    }

    pub(super) fn is_narrow(&self, alpha: f32) -> bool {
        match self.parts() {
            Some(Parts::Principled(lobe)) => lobe.is_narrow(alpha),
            Some(Parts::Blend(lobes, _)) => lobes.iter().all(|lobe| lobe.is_narrow(alpha)),
            Some(Parts::Perturbed(lobe, _)) => lobe.is_narrow(alpha),
            None => true,
        }
    }

    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        match self.parts() {
            Some(Parts::Principled(lobe)) => lobe.albedo(),
            Some(Parts::Blend([a, b], w)) => a.albedo(wo).lerp(b.albedo(wo), w),
            Some(Parts::Perturbed(lobe, _)) => lobe.albedo(wo),
            None => Rgb::ZERO,
        }
    }
}

/// Whether a bump map is somewhere in the material.
fn is_bumpy(materials: &Materials, id: MaterialId) -> bool {
    let nested = |inner: &MaterialId| inner.0 < id.0 && is_bumpy(materials, *inner);
    match materials.get(id) {
        Some(Material::Perturbed { by: Perturbation::Bump { .. }, .. }) => true,
        Some(Material::Perturbed { material, .. } | Material::Mask { material, .. }) => nested(material),
        Some(Material::Blend { first, second, .. }) => nested(first) || nested(second),
        Some(Material::TwoSided { front, back }) => nested(front) || nested(back),
        _ => false,
    }
}

/// See [`Composite::tangents`]. Where texture coordinates give no directions, their axes are those of any frame.
fn tangents(materials: &Materials, point: &SurfacePoint) -> Vec3 {
    let Some([by_u, by_v]) = point.dp_duv(&materials.scene.shapes) else { return Vec3::new(1.0, 0.0, 1.0) };
    let frame = Frame::from_z_and_tangent(point.ns, by_u);
    Vec3::new(frame.x.dot(by_u), frame.x.dot(by_v), frame.y.dot(by_v))
}

fn sample_blend(
    lobes: &[Lobe; 2],
    weight: f32,
    wo: Vec3,
    [u, u1, u2]: [f32; 3],
    mode: TransportMode,
) -> Option<BsdfSample> {
    // The part of `u` that is left over by the choice serves the lobe.
    let (chosen, probability, rest) = if u < weight {
        (&lobes[1], weight, u / weight)
    } else {
        (&lobes[0], 1.0 - weight, (u - weight) / (1.0 - weight))
    };
    let sample = chosen.sample(wo, [rest.min(1.0 - f32::EPSILON), u1, u2], mode)?;
    if sample.is_delta {
        return Some(BsdfSample { pdf: sample.pdf * probability, ..sample });
    }
    let pdf = blend_pdf(lobes, weight, wo, sample.wi, mode);
    let value =
        lobes[0].eval(wo, sample.wi, mode) * (1.0 - weight) + lobes[1].eval(wo, sample.wi, mode) * weight;
    let weight = value * (sample.wi.z.abs() / pdf);
    (pdf > 0.0).then_some(BsdfSample { weight, pdf, ..sample })
}

fn blend_pdf(lobes: &[Lobe; 2], weight: f32, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
    let density = |lobe: &Lobe, w: f32| if w > 0.0 { lobe.pdf(wo, wi, mode) * w } else { 0.0 };
    density(&lobes[0], 1.0 - weight) + density(&lobes[1], weight)
}

/// A perturbed normal and what is done about its side effects.
///
/// The perturbed normal may depend on the viewer, because a normal that turns away from the viewer is mirrored. The viewer
/// is `wo` for paths from the camera, but `wi` for paths from a light. Those do not know it before they have chosen `wi`: they try
/// either normal with equal probability, and a direction that does not see the normal it was made with is dropped.
struct Perturbed {
    /// Unit length, in the frame of `wo`'s side.
    normal: Vec3,
    flips: bool,
    shadowing: bool,
}

/// Less than this over a surface counts as not over it: what follows divides by it.
const GRAZING: f32 = 1e-12;

impl Perturbed {
    /// The normal that a viewer on either side sees.
    #[inline]
    fn seen_from(&self, view: Vec3) -> Vec3 {
        let turns_away = view.z * view.dot(self.normal) <= 0.0;
        if self.flips && turns_away { mirrored(self.normal) } else { self.normal }
    }

    /// Whether light paths have two normals to choose from.
    #[inline]
    fn is_ambiguous(&self, mode: TransportMode) -> bool {
        mode == TransportMode::Importance && self.flips && self.normal != mirrored(self.normal)
    }

    /// Both directions in the perturbed frame, unless one of them changes sides.
    #[inline]
    fn to_local(n: Vec3, wo: Vec3, wi: Vec3) -> Option<[Vec3; 2]> {
        let frame = Frame::from_z_and_tangent(n, Vec3::X);
        let (wo_local, wi_local) = (frame.to_local(wo), frame.to_local(wi));
        let same_side = |w: Vec3, local: Vec3| w.z * local.z > 0.0 && w.z.abs() > GRAZING;
        (same_side(wo, wo_local) && same_side(wi, wi_local)).then_some([wo_local, wi_local])
    }

    fn sample(
        &self,
        lobe: &Lobe,
        wo: Vec3,
        [u, u1, u2]: [f32; 3],
        mode: TransportMode,
    ) -> Option<BsdfSample> {
        let ambiguous = self.is_ambiguous(mode);
        let (n, u) = match (mode, ambiguous) {
            (TransportMode::Radiance, _) => (self.seen_from(wo), u),
            (TransportMode::Importance, false) => (self.normal, u),
            (TransportMode::Importance, true) if u < 0.5 => (self.normal, 2.0 * u),
            (TransportMode::Importance, true) => (mirrored(self.normal), 2.0 * u - 1.0),
        };
        let frame = Frame::from_z_and_tangent(n, Vec3::X);
        let wo_local = frame.to_local(wo);
        if wo_local.z <= 0.0 {
            return None;
        }
        let sample = lobe.sample(wo_local, [u, u1, u2], mode)?;
        let wi = frame.to_world(sample.wi);
        let [_, wi_local] = Self::to_local(n, wo, wi)?;
        if ambiguous && self.seen_from(wi) != n {
            return None;
        }
        let choice = if ambiguous { 0.5 } else { 1.0 };
        let weight = sample.weight * (self.factor(n, wo, wi, mode) / choice);
        let weight = match mode {
            TransportMode::Radiance => weight,
            TransportMode::Importance => weight * ((wo_local.z * wi.z) / (wo.z * wi_local.z)).abs(),
        };
        Some(BsdfSample { wi, weight, pdf: sample.pdf * choice, ..sample })
    }

    fn eval(&self, lobe: &Lobe, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        let n = self.seen_from(if mode == TransportMode::Radiance { wo } else { wi });
        let Some([wo_local, wi_local]) = Self::to_local(n, wo, wi) else { return Rgb::ZERO };
        // The caller multiplies by the cosine to the unperturbed normal; the light's counts.
        let (light, light_local) =
            if mode == TransportMode::Radiance { (wi, wi_local) } else { (wo, wo_local) };
        let cosines = (light_local.z / light.z).abs();
        lobe.eval(wo_local, wi_local, mode) * (cosines * self.factor(n, wo, wi, mode))
    }

    fn pdf(&self, lobe: &Lobe, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
        let n = self.seen_from(if mode == TransportMode::Radiance { wo } else { wi });
        let choice = if self.is_ambiguous(mode) { 0.5 } else { 1.0 };
        Self::to_local(n, wo, wi).map_or(0.0, |[wo, wi]| lobe.pdf(wo, wi, mode) * choice)
    }

    /// The shadowing of the light's direction by the bumps (Estevez et al. 2019, "A microfacet-based shadowing function to solve the
    /// bump terminator problem").
    fn factor(&self, n: Vec3, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
        if !self.shadowing {
            return 1.0;
        }
        let light = if mode == TransportMode::Radiance { wi } else { wo };
        let tan2 = |w: Vec3| (w.x * w.x + w.y * w.y) / (w.z * w.z);
        let alpha2 = (0.125 * tan2(n)).min(1.0);
        2.0 / (1.0 + (1.0 + alpha2 * tan2(light)).sqrt())
    }
}

/// The normal on the other side of the surface's; from below, also the normal that is seen there.
#[inline]
fn mirrored(n: Vec3) -> Vec3 {
    Vec3::new(-n.x, -n.y, n.z)
}
