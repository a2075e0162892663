//! The `integrator` of a scene: whose name stands for which algorithm here.
//!
//! Which algorithms there are, and what their parameters mean, is known above the scene; names and parameters pass as text. Here those of
//! Mitsuba are unwrapped and translated where something else does the same.

use super::super::{LoadError, Log};
use super::xml::{Category, Document, Object, one_of};
use crate::scene::IntegratorSettings;

/// Integrators around another that only add outputs.
const WRAPPERS: [&str; 2] = ["moment", "aov"];

/// Mitsuba's name, ours, and a parameter that is fixed.
type Synonym = (&'static str, &'static str, Option<(&'static str, &'static str)>);

/// Mitsuba's integrators that are one of ours with a parameter fixed. Those for media are `path` in scenes without.
const SYNONYMS: &[Synonym] = &[
    ("direct", "path", Some(("max_depth", "2"))),
    ("volpath", "path", None),
    ("volpathmis", "path", None),
    ("volpath_simple", "path", None),
];

/// Parameters that only change the noise.
const NOISE: [&str; 4] = ["shading_samples", "emitter_samples", "bsdf_samples", "samples_per_pass"];

/// Integrators within integrators; they could run in circles by reference.
const MAX_NESTING: usize = 10;

/// What an integrator object asks for.
pub(super) fn settings(
    document: &Document,
    object: &Object,
    log: &mut Log,
) -> Result<IntegratorSettings, LoadError> {
    let mut object = object;
    for _ in 0..MAX_NESTING {
        if !WRAPPERS.contains(&object.plugin.as_str()) {
            return plain(document, object, log);
        }
        let inner: Vec<_> = object.children.iter().map(|child| document.object(child.object)).collect();
        match inner[..] {
            [only] if only.category == Category::Integrator => object = only,
            _ => {
                let found = format!("integrator `{}` around {} objects", object.plugin, inner.len());
                return Err(document.error(object.at, found, "one integrator in it"));
            }
        }
    }
    Err(document.error(object.at, "integrators in each other", format!("at most {MAX_NESTING} levels")))
}

fn plain(document: &Document, object: &Object, log: &mut Log) -> Result<IntegratorSettings, LoadError> {
    if let Some(child) = object.children.first() {
        let inner = document.object(child.object);
        let found = format!("{} `{}` in integrator `{}`", inner.category, inner.plugin, object.plugin);
        let expected = format!("an integrator with values only; around others {}", one_of(&WRAPPERS));
        log.unsupported(document.error(child.at, found, expected), "it is ignored")?;
    }
    let synonym = SYNONYMS.iter().find(|(name, ..)| *name == object.plugin);
    let (name, fixed) = synonym.map_or((object.plugin.as_str(), None), |(_, ours, fixed)| (*ours, *fixed));
    let mut parameters: Vec<(String, String)> = Vec::new();
    for property in &object.properties {
        if synonym.is_some() && NOISE.contains(&property.name.as_str()) {
            log.note(document.locate(property.at), format!("`{}` has no effect", property.name));
        } else {
            parameters.push((property.name.clone(), property.text.clone()));
        }
    }
    parameters.extend(fixed.map(|(name, value)| (name.to_owned(), value.to_owned())));
    if synonym.is_some() {
        log.note(
            document.locate(object.at),
            format!("integrator `{}` is rendered by `{name}`", object.plugin),
        );
    }
    Ok(IntegratorSettings {
        name: Some(name.to_owned()),
        parameters,
        location: Some(document.locate(object.at)),
    })
}
