//! Which integrator samples which class of paths: well, poorly or not at all.
//!
//! Answers follow from how strategies meet, and say nothing about noise within what is sampled well: a lamp that no surface sees is a matter of the scene, which
//! [`study::pilot`](crate::study::pilot) measures. They are checked by `inspect --verify` and by tests: what cannot be sampled has no energy there.

use super::Integrator;
use super::forward::Connect;
use super::photon_map::{Direct, Mode};
use super::vpl::Visibility;
use crate::scene::requirements::{PathClass, Requirements};

/// How well an integrator samples a class of paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ability {
    /// Never: that light is missing.
    Cannot,
    /// By luck: converges slowly, with bright specks.
    Poorly,
    /// With a strategy made for it.
    Well,
}

impl Ability {
    /// A word for tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Cannot => "cannot",
            Self::Poorly => "poorly",
            Self::Well => "well",
        }
    }
}

impl Integrator {
    /// How well it samples a class of paths in a scene with these requirements; the worst answer if lights differ.
    pub fn ability(&self, class: PathClass, needs: &Requirements) -> Ability {
        use PathClass::{
            Caustic, CausticElsewhere, CausticMirrored, Direct as DirectLight, DirectMirrored, Emission,
        };
        let is_emission = matches!(class, Emission | PathClass::EmissionMirrored);
        match self {
            _ if is_emission && !self.only_splats() => Ability::Well,
            Self::Backward(_) if class.is_caustic() => by_hitting(needs),
            Self::Backward(_) => Ability::Well,
            Self::Forward(forward) => {
                let has_lens = needs.has_lens && forward.connect != Connect::Nee;
                let is_hit = if has_lens { Ability::Poorly } else { Ability::Cannot };
                if class.is_mirrored() || forward.connect == Connect::Hit {
                    is_hit
                } else if needs.is_orthographic && class == Emission && needs.lights.area == 0 {
                    Ability::Cannot
                } else {
                    of_distant(needs)
                }
            }
            Self::Bidirectional(_) => match class {
                CausticMirrored => by_hitting(needs),
                // LSDSDSE is among them, which no strategy connects.
                PathClass::CausticElsewhereMirrored => by_hitting(needs).max(Ability::Poorly),
                _ => Ability::Well,
            },
            Self::PhotonMap(mapper) => match (mapper.mode, mapper.direct) {
                (Mode::Caustic, _) if !class.is_caustic() => Ability::Well,
                (Mode::Full, Direct::Nee) if matches!(class, DirectLight | DirectMirrored) => Ability::Well,
                _ => of_distant(needs),
            },
            Self::VirtualLights(vpl) => match class {
                Caustic | CausticMirrored if vpl.compensate => by_hitting(needs),
                Caustic | CausticMirrored => Ability::Cannot,
                // Between two surfaces D by virtual lights, but not what a surface D sees of a caustic in a mirror.
                CausticElsewhere | PathClass::CausticElsewhereMirrored => Ability::Poorly,
                PathClass::Indirect | PathClass::IndirectMirrored => of_distant(needs),
                _ => Ability::Well,
            },
        }
    }

    /// The classes of paths that exist in a scene with these requirements and of which it cannot find all light.
    pub fn blind_to(&self, needs: &Requirements) -> Vec<PathClass> {
        let classes = needs.classes(self.length().limit());
        classes.into_iter().filter(|&class| self.ability(class, needs) == Ability::Cannot).collect()
    }

    /// What is wrong with its image however many passes are made; `None` if nothing is.
    pub fn bias(&self) -> Option<&'static str> {
        match self {
            Self::PhotonMap(_) => Some("photons blur light over their disc and darken edges"),
            Self::VirtualLights(vpl) if vpl.visibility == Visibility::None => {
                Some("without visibility indirect light has no shadows")
            }
            Self::VirtualLights(vpl) if !vpl.compensate => {
                Some("what the clamp takes is lost, and caustics with it")
            }
            Self::VirtualLights(vpl) if vpl.visibility != Visibility::Rays => {
                Some("shadow maps blur indirect shadows")
            }
            Self::Backward(_) | Self::Forward(_) | Self::Bidirectional(_) | Self::VirtualLights(_) => None,
        }
    }
}

/// Of paths that end by hitting a light after delta events.
fn by_hitting(needs: &Requirements) -> Ability {
    if needs.lights.delta() > 0 {
        Ability::Cannot
    } else if needs.lights.area + needs.lights.maps > 0 {
        Ability::Poorly
    } else {
        Ability::Well
    }
}

/// Of light paths: little of what is sent from afar comes near what is seen.
fn of_distant(needs: &Requirements) -> Ability {
    if needs.lights.distant() > 0 { Ability::Poorly } else { Ability::Well }
}
