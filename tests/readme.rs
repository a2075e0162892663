//! The table of what is supported is in `vendor-notes/mitsuba-format.md` as the loader's own tables make it.

use std::fmt::Write;
use std::path::Path;

use helmholtz::scene::load::mitsuba::{Default, Kind, supported};

/// A section per category, a line per plugin, its parameters with types and defaults.
fn table() -> String {
    let mut text = String::from(
        "# What of Mitsuba's format is supported\n\n\
         Made from the loader's own tables by `UPDATE_TABLE=1 cargo test --release readme`; a test fails when it is stale.\n\
         Scenes of Mitsuba 3, of Mitsuba 2 and of 0.4 to 0.6 load; the latter under the names given here. Anything else is an error that\n\
         says where and what, or with `--lenient` replaced with a warning.\n",
    );
    let mut last = String::new();
    for (category, plugin) in supported() {
        let category = category.to_string();
        if category != last {
            let _ = write!(text, "\n## {category}\n\n| plugin | what it is | parameters |\n|---|---|---|\n");
            last = category;
        }
        let parameters: Vec<String> = plugin
            .parameters()
            .map(|p| {
                let default = match p.default {
                    Default::Required => ", required".to_owned(),
                    Default::Unset => String::new(),
                    Default::Value(value) => format!(" = {value}"),
                };
                match p.kind {
                    Kind::Object(category) => format!("<{category}>: {}", p.help),
                    kind => format!("`{}` ({}{default}): {}", p.name, kind.elements(), p.help),
                }
            })
            .collect();
        let parameters =
            parameters.join("<br>").replace("<bsdf>", "`<bsdf>`").replace("<emitter>", "`<emitter>`");
        let parameters = ["film", "sampler", "rfilter", "shape", "texture"]
            .iter()
            .fold(parameters, |text, c| text.replace(&format!("<{c}>"), &format!("`<{c}>`")))
            .replace("<path>", "`<path>`")
            .replace("<ref>", "`<ref>`");
        let _ = writeln!(text, "| `{}` | {} | {parameters} |", plugin.name, plugin.help);
    }
    text
}

#[test]
fn the_table_of_the_format_is_current() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("vendor-notes/mitsuba-format.md");
    let table = table();
    if std::env::var_os("UPDATE_TABLE").is_some() {
        std::fs::write(&path, &table).expect("written");
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(written == table, "{} is stale: UPDATE_TABLE=1 cargo test --release readme", path.display());
}
