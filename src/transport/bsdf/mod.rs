//! How surfaces scatter light: materials prepared for one surface point.
//!
//! Directions are unit vectors in local coordinates (z = shading normal, see [`Frame`]) that point *away* from the surface:
//! `wo` to where the path came from, `wi` to where it goes on. Meaning and conventions of the materials are those
//! of Mitsuba 3's plugins of the same names. Directions here know only the shading normal; checks against the geometric
//! normal and Veach's adjoint correction belong to the path vertex, not here.
//!
//! Rough materials use Smith's masking separably, `G = G1(wo) G1(wi)`, and scatter at most once. So they lose what
//! in reality bounces on between the facets: of a white GGX metal 1 to 3 % at roughness 0.1, and all but `1 - ln 2` (31 %) at roughness 1
//! seen from straight above.
//!
//! ```
//! use glam::Vec3;
//! use helmholtz::transport::bsdf::Frame;
//!
//! let frame = Frame::from_z(Vec3::new(0.0, 0.6, 0.8));
//! assert!((frame.to_local(frame.z) - Vec3::Z).length() < 1e-6);
//! ```

mod composite;
mod conductor;
mod dielectric;
mod frame;
pub mod fresnel;
mod materials;
pub mod microfacet;
mod plastic;
mod principled;

pub use frame::Frame;
pub use materials::Materials;

use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

use crate::sampling::warp::{cosine_hemisphere_pdf, square_to_cosine_hemisphere};
use crate::scene::{Input, Material, MaterialId, Microfacet, Place, Rgb, SurfacePoint, Textures};
use composite::Composite;
use conductor::{Metal, RoughConductor};
use dielectric::{Boundary, RoughDielectric};
use microfacet::Microfacets;
use plastic::Plastic;

/// What flows along the path that is being extended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransportMode {
    /// The path started at the camera and gathers radiance.
    Radiance,
    /// The path started at a light and carries power, of which it delivers the part that the camera finds important.
    Importance,
}

impl TransportMode {
    /// What the other subpath carries.
    #[inline]
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Radiance => Self::Importance,
            Self::Importance => Self::Radiance,
        }
    }
}

/// One way to go on from a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BsdfSample {
    /// The direction drawn.
    pub wi: Vec3,
    /// `f |cos(wi)| / pdf`.
    pub weight: Rgb,
    /// Density per solid angle; for a delta lobe the probability that the lobe is chosen.
    pub pdf: f32,
    /// Whether the direction is one of finitely many. Such a vertex cannot be connected.
    pub is_delta: bool,
    /// Index of refraction on `wi`'s side over that on `wo`'s side; 1 for reflection.
    pub eta: f32,
}

/// A material prepared for one surface point and the side that a path reaches it on.
///
/// Of what does not transmit light, the other side is black: no path passes from one side to the other. A boundary is known from
/// both sides, because the density of going back from `wi` is asked for too.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf<'s> {
    lobe: Lobe<'s>,
    /// Whether `lobe` is for directions above the surface.
    is_above: bool,
}

/// What a surface does with light on the side that the local z axis points to.
#[derive(Debug, Clone, Copy)]
enum Lobe<'s> {
    Black,
    Diffuse { reflectance: Rgb },
    Conductor(Metal),
    RoughConductor(RoughConductor),
    Dielectric(Boundary),
    RoughDielectric(RoughDielectric),
    ThinDielectric(Boundary),
    Plastic(Plastic<'s>),
    Null,
    Composite(Composite<'s>),
}

// Copied per path vertex.
const _: () = assert!(size_of::<Bsdf>() <= 56);

/// Least product of roughness and `|eta - 1|`: the width in radians of a refracted lobe that f32 directions still resolve.
const MIN_REFRACTED_WIDTH: f32 = 1e-6;

impl<'s> Bsdf<'s> {
    /// Prepares a material for paths that arrive from above the shading surface, or from below. A [`Material::TwoSided`] shows the
    /// front of each of its materials; one that refers to a transmitting material, to itself or to none is black (loaders refuse it).
    ///
    /// A rough boundary whose refracted lobe is too narrow for f32 (roughness times `|eta - 1|` below 1e-6) is prepared as
    /// a smooth one, or at the least roughness that can be resolved.
    #[inline(always)]
    pub fn new(materials: &'s Materials<'s>, id: MaterialId, point: &SurfacePoint, is_above: bool) -> Self {
        let Some((shown, is_front)) = Lobe::shown(materials, id, is_above) else {
            return Self { lobe: Lobe::Black, is_above };
        };
        // The commonest material is written where it stays, and not copied from where it might be turned over.
        if let Some(&Material::Diffuse { reflectance: Input::Constant(reflectance) }) = materials.get(shown) {
            let reflectance = reflectance.clamp(Rgb::ZERO, Rgb::ONE);
            let lobe = if is_front { Lobe::Diffuse { reflectance } } else { Lobe::Black };
            return Self { lobe, is_above };
        }
        // Of a copy, so that the point itself needs no address.
        let point = *point;
        let composite = |id, is_above| Composite::new(materials, id, &point, is_above);
        Self { lobe: Lobe::new(materials, id, (&point).into(), is_above, composite), is_above }
    }

    /// Draws a direction for the path to go on; `u[0]` chooses the lobe, the others the direction, all in [0, 1).
    /// `None` if the light is absorbed or `wo` is not usable.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, u: [f32; 3], mode: TransportMode) -> Option<BsdfSample> {
        let mut other = Lobe::Black;
        let (lobe, wo, side) = self.facing(wo, &mut other)?;
        let sample = lobe.sample(wo, u, mode)?;
        Some(BsdfSample { wi: sample.wi * side, ..sample })
    }

    /// The value `f(wo, wi)`, without the cosine; 0 for delta lobes.
    ///
    /// In mode `Radiance` light flows from `wi` to `wo`, in mode `Importance` from `wo` to `wi`:
    /// `eval(wo, wi, Importance) == eval(wi, wo, Radiance)`.
    #[inline(always)]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        let mut other = Lobe::Black;
        // Not `map_or`, whose closure is not always inlined.
        let Some((lobe, wo, side)) = self.facing(wo, &mut other) else { return Rgb::ZERO };
        lobe.eval(wo, wi * side, mode)
    }

    /// Density per solid angle with which [`sample`](Self::sample) draws `wi`, without delta lobes. It integrates to the probability
    /// that `sample` returns anything.
    #[inline(always)]
    pub fn pdf(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
        let mut other = Lobe::Black;
        let Some((lobe, wo, side)) = self.facing(wo, &mut other) else { return 0.0 };
        lobe.pdf(wo, wi * side, mode)
    }

    /// [`eval`](Self::eval), [`pdf`](Self::pdf), and `pdf` of the way back with the other mode.
    #[inline(always)]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> (Rgb, f32, f32) {
        if let Lobe::Diffuse { reflectance } = self.lobe {
            let up = if self.is_above { 1.0 } else { -1.0 };
            let (cos_o, cos_i) = (wo.z * up, wi.z * up);
            return if cos_o > 0.0 && cos_i > 0.0 {
                (reflectance * FRAC_1_PI, cosine_hemisphere_pdf(cos_i), cosine_hemisphere_pdf(cos_o))
            } else {
                (Rgb::ZERO, 0.0, 0.0)
            };
        }
        (self.eval(wo, wi, mode), self.pdf(wo, wi, mode), self.pdf(wi, wo, mode.other()))
    }

    /// Whether there are only delta lobes (or none at all), so that the vertex cannot be connected.
    #[inline]
    pub fn is_delta(&self) -> bool {
        self.lobe.is_delta()
    }

    /// Whether `u[0]` of [`sample`](Self::sample) matters: there is more than one lobe to choose from.
    #[inline]
    pub fn has_lobes(&self) -> bool {
        matches!(
            self.lobe,
            Lobe::Dielectric(_)
                | Lobe::RoughDielectric(_)
                | Lobe::ThinDielectric(_)
                | Lobe::Plastic(_)
                | Lobe::Composite(_)
        )
    }

    /// Reflectance of a surface that is nothing but diffuse, on the side that was prepared.
    #[inline]
    pub fn diffuse_reflectance(&self) -> Option<Rgb> {
        match self.lobe {
            Lobe::Diffuse { reflectance } => Some(reflectance),
            _ => None,
        }
    }

    /// Whether all that is scattered goes into delta lobes or such as are no wider than the mirror lobe of a metal of roughness `alpha`, seen from either side: the
    /// answer is the same for paths that arrive on different sides. By 0 this is [`is_delta`](Self::is_delta).
    pub fn is_narrow(&self, alpha: f32) -> bool {
        let other = || self.lobe.turned_over().is_none_or(|lobe| lobe.is_narrow(alpha));
        self.is_delta() || (self.lobe.is_narrow(alpha) && other())
    }

    /// Whether all that is scattered stays on the side it came from. Of what is made of others this is not asked, and they may not.
    #[inline]
    pub fn is_opaque(&self) -> bool {
        match self.lobe {
            Lobe::Black
            | Lobe::Diffuse { .. }
            | Lobe::Conductor(_)
            | Lobe::RoughConductor(_)
            | Lobe::Plastic(_) => true,
            Lobe::Dielectric(_)
            | Lobe::RoughDielectric(_)
            | Lobe::ThinDielectric(_)
            | Lobe::Null
            | Lobe::Composite(_) => false,
        }
    }

    /// Whether the tangents of the frame matter, and not its normal alone.
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        self.lobe.is_anisotropic()
    }

    /// Reflectance and transmittance together, for the albedo AOV. Exact for smooth materials and the diffuse one (power, so
    /// without the radiance's change by the index); rough ones answer as if they were smooth.
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        let mut other = Lobe::Black;
        self.facing(wo, &mut other).map_or(Rgb::ZERO, |(lobe, wo, _)| lobe.albedo(wo))
    }

    /// The lobe on `wo`'s side, `wo` in its coordinates, and the factor that turns other directions over too. `other` is where the
    /// lobe is put if it is not the one that was prepared.
    #[inline(always)]
    fn facing<'a>(&'a self, wo: Vec3, other: &'a mut Lobe<'s>) -> Option<(&'a Lobe<'s>, Vec3, Vec3)> {
        let is_above = wo.z > 0.0;
        // Neither side: in the plane of the surface, or NaN.
        if wo.z == 0.0 || wo.z.is_nan() {
            return None;
        }
        let side = Vec3::new(1.0, 1.0, if is_above { 1.0 } else { -1.0 });
        if is_above == self.is_above {
            return Some((&self.lobe, wo * side, side));
        }
        *other = self.lobe.turned_over()?;
        Some((other, wo * side, side))
    }
}

// Only the diffuse lobe is inlined into integrators. The others do enough work to be worth a call, and would crowd it out.
impl<'s> Lobe<'s> {
    /// Prepares a material for the side that is looked at. `composite` makes the lobe of one that is made of others, for a side.
    #[inline(never)]
    fn new(
        materials: &'s Materials<'s>,
        id: MaterialId,
        place: Place,
        is_above: bool,
        composite: impl Fn(MaterialId, bool) -> Composite<'s>,
    ) -> Self {
        let Some((id, is_front)) = Self::shown(materials, id, is_above) else { return Self::Black };
        let Some(material) = materials.get(id) else { return Self::Black };
        let lobe = Self::of_material(materials, id, material, place, || composite(id, is_front));
        if is_front || matches!(lobe, Self::Composite(_)) {
            lobe
        } else {
            lobe.turned_over().unwrap_or(Self::Black)
        }
    }

    /// The material seen on a side, and whether that is its front; a [`Material::TwoSided`] stands for another. `None` for black.
    #[inline(always)]
    fn shown(materials: &Materials, id: MaterialId, is_above: bool) -> Option<(MaterialId, bool)> {
        let Some(&Material::TwoSided { front, back }) = materials.get(id) else {
            return Some((id, is_above));
        };
        let inner = if is_above { front } else { back };
        (!materials.traits(inner).transmits && inner.0 < id.0).then_some((inner, true))
    }

    /// The front of a material; of composites the side that `composite` makes.
    #[inline(never)]
    fn of_material(
        materials: &'s Materials<'s>,
        id: MaterialId,
        material: &Material,
        place: Place,
        composite: impl FnOnce() -> Composite<'s>,
    ) -> Self {
        let textures = Textures::of(materials.scene());
        let color = |input: Input<Rgb>| input.at(textures, place);
        let factor = |input: Input<Rgb>| color(input).clamp(Rgb::ZERO, Rgb::ONE);
        let boundary = |eta, reflection, transmission| Boundary {
            eta,
            reflection: factor(reflection),
            transmission: factor(transmission),
        };
        match *material {
            Material::Diffuse { reflectance } => Self::Diffuse { reflectance: factor(reflectance) },
            Material::Conductor { eta, k, specular_reflectance: tint } => {
                Self::Conductor(Metal { eta: color(eta), k: color(k), tint: factor(tint) })
            }
            Material::RoughConductor { distribution, alpha, eta, k, specular_reflectance: tint } => {
                let facets = Microfacets::new(distribution, alpha.map(|a| a.at(textures, place)), 0.0);
                let metal = Metal { eta: color(eta), k: color(k), tint: factor(tint) };
                Self::RoughConductor(RoughConductor { facets, metal })
            }
            Material::Dielectric { eta, specular_reflectance, specular_transmittance } => {
                Self::Dielectric(boundary(eta, specular_reflectance, specular_transmittance))
            }
            Material::RoughDielectric {
                distribution,
                alpha,
                eta,
                specular_reflectance,
                specular_transmittance,
            } => {
                let alpha = alpha.map(|a| a.at(textures, place));
                let boundary = boundary(eta, specular_reflectance, specular_transmittance);
                Self::rough_dielectric(distribution, alpha, boundary)
            }
            Material::ThinDielectric { eta, specular_reflectance, specular_transmittance } => {
                Self::ThinDielectric(boundary(eta, specular_reflectance, specular_transmittance))
            }
            Material::Plastic { diffuse_reflectance, specular_reflectance, nonlinear, .. } => {
                materials.coat(id).map_or(Self::Black, |coat| {
                    let (diffuse, specular) = (factor(diffuse_reflectance), factor(specular_reflectance));
                    Self::Plastic(Plastic::new(coat, diffuse, specular, nonlinear))
                })
            }
            Material::Null => Self::Null,
            Material::Principled(_)
            | Material::Mask { .. }
            | Material::Blend { .. }
            | Material::Perturbed { .. } => Self::Composite(composite()),
            Material::TwoSided { .. } => Self::Black,
        }
    }

    #[inline(never)]
    fn rough_dielectric(distribution: Microfacet, alpha: [f32; 2], boundary: Boundary) -> Self {
        let min_alpha = MIN_REFRACTED_WIDTH / (boundary.eta - 1.0).abs();
        if alpha[0].max(alpha[1]) < min_alpha {
            return Self::Dielectric(boundary);
        }
        let facets = Microfacets::new(distribution, alpha, min_alpha);
        Self::RoughDielectric(RoughDielectric { facets, boundary })
    }

    /// What is seen from the other side, if light gets there.
    #[inline(never)]
    fn turned_over(&self) -> Option<Self> {
        match *self {
            Self::Dielectric(boundary) => Some(Self::Dielectric(boundary.turned_over())),
            Self::RoughDielectric(RoughDielectric { facets, boundary }) => {
                Some(Self::RoughDielectric(RoughDielectric { facets, boundary: boundary.turned_over() }))
            }
            Self::ThinDielectric(_) | Self::Null => Some(*self),
            Self::Composite(composite) => composite.turned_over().map(Self::Composite),
            Self::Black
            | Self::Diffuse { .. }
            | Self::Conductor(_)
            | Self::RoughConductor(_)
            | Self::Plastic(_) => None,
        }
    }

    #[inline(always)]
    fn sample(&self, wo: Vec3, [u, u1, u2]: [f32; 3], mode: TransportMode) -> Option<BsdfSample> {
        let u_direction = Vec2::new(u1, u2);
        match self {
            Self::Black => None,
            Self::Diffuse { reflectance } => {
                let wi = square_to_cosine_hemisphere(u_direction);
                let pdf = cosine_hemisphere_pdf(wi.z);
                Some(BsdfSample { wi, weight: *reflectance, pdf, is_delta: false, eta: 1.0 })
            }
            Self::Conductor(metal) => Some(metal.sample_mirror(wo)),
            Self::RoughConductor(rough) => rough.sample(wo, u_direction),
            Self::Dielectric(boundary) => Some(boundary.sample_smooth(wo, u, mode)),
            Self::RoughDielectric(rough) => rough.sample(wo, u, u_direction, mode),
            Self::ThinDielectric(sheet) => Some(sheet.sample_thin(wo, u)),
            Self::Plastic(plastic) => plastic.sample(wo, u, u_direction),
            Self::Null => Some(BsdfSample { wi: -wo, weight: Rgb::ONE, pdf: 1.0, is_delta: true, eta: 1.0 }),
            Self::Composite(composite) => composite.sample(wo, [u, u1, u2], mode),
        }
    }

    #[inline(always)]
    fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        match self {
            Self::Diffuse { reflectance } if wi.z > 0.0 => *reflectance * FRAC_1_PI,
            Self::RoughConductor(rough) => rough.eval(wo, wi),
            Self::RoughDielectric(rough) => rough.eval(wo, wi, mode),
            Self::Plastic(plastic) => plastic.eval(wo, wi),
            Self::Composite(composite) => composite.eval(wo, wi, mode),
            Self::Diffuse { .. }
            | Self::Black
            | Self::Conductor(_)
            | Self::Dielectric(_)
            | Self::ThinDielectric(_)
            | Self::Null => Rgb::ZERO,
        }
    }

    #[inline(always)]
    fn pdf(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
        match self {
            Self::Black | Self::Conductor(_) | Self::Dielectric(_) | Self::ThinDielectric(_) | Self::Null => {
                0.0
            }
            Self::Diffuse { .. } => cosine_hemisphere_pdf(wi.z),
            Self::RoughConductor(rough) => rough.pdf(wo, wi),
            Self::RoughDielectric(rough) => rough.pdf(wo, wi),
            Self::Plastic(plastic) => plastic.pdf(wo, wi),
            Self::Composite(composite) => composite.pdf(wo, wi, mode),
        }
    }

    #[inline]
    fn is_delta(&self) -> bool {
        match self {
            Self::Black | Self::Conductor(_) | Self::Dielectric(_) | Self::ThinDielectric(_) | Self::Null => {
                true
            }
            Self::Composite(composite) => composite.is_delta(),
            Self::Diffuse { .. } | Self::RoughConductor(_) | Self::RoughDielectric(_) | Self::Plastic(_) => {
                false
            }
        }
    }

    fn is_narrow(&self, alpha: f32) -> bool {
        match self {
            Self::RoughConductor(rough) => rough.facets.mean_alpha() < alpha,
            Self::RoughDielectric(rough) => rough.refracted_alpha() < alpha,
            Self::Composite(composite) => composite.is_narrow(alpha),
            _ => self.is_delta(),
        }
    }

    #[inline]
    fn is_anisotropic(&self) -> bool {
        match self {
            Self::RoughConductor(RoughConductor { facets, .. })
            | Self::RoughDielectric(RoughDielectric { facets, .. }) => facets.is_anisotropic(),
            // Not worth asking its parts.
            Self::Composite(_) => true,
            _ => false,
        }
    }

    #[inline]
    fn albedo(&self, wo: Vec3) -> Rgb {
        match self {
            Self::Black => Rgb::ZERO,
            Self::Diffuse { reflectance } => *reflectance,
            Self::Conductor(metal) | Self::RoughConductor(RoughConductor { metal, .. }) => {
                metal.reflectance(wo.z)
            }
            Self::Dielectric(boundary) | Self::RoughDielectric(RoughDielectric { boundary, .. }) => {
                boundary.albedo(wo)
            }
            Self::ThinDielectric(sheet) => sheet.thin_albedo(wo),
            Self::Plastic(plastic) => plastic.albedo(wo),
            Self::Null => Rgb::ONE,
            Self::Composite(composite) => composite.albedo(wo),
        }
    }
}

/// Mirrors `wo` at a microfacet normal `m`, given `cos_om = wo . m`.
#[inline]
fn reflect(wo: Vec3, m: Vec3, cos_om: f32) -> Vec3 {
    2.0 * cos_om * m - wo
}
