//! `helmholtz selftest`: how this build holds at the extremes, on this machine.

use std::fmt::Write as _;

use clap::Args;
use serde_json::json;

use super::{CliError, EXIT_DONE, EXIT_FAULTS};
use crate::selftest::{Bench, Effort, Finding, Group, run as run_group};

/// Check this build on this machine at the extremes
///
/// Runs every backend and integrator on scenes whose result is known: closed meshes, glowing boxes and white furnaces, at scales from 1e-6 to 1e6, far from the origin, turned
/// and squeezed, with radiance over 40 decades. Prints what was measured and what it may be at most. Takes about a minute; exits with code 4 if a check fails.
#[derive(Debug, Args)]
pub(super) struct SelftestArgs {
    /// A hundred times as many rays and more samples: takes half an hour on two cores
    #[arg(long)]
    full: bool,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &SelftestArgs) -> Result<u8, CliError> {
    let effort = if args.full { Effort::Full } else { Effort::Quick };
    let mut all = Vec::new();
    for group in Group::ALL {
        for bench in Bench::all(effort) {
            let findings = run_group(group, &bench)?;
            if !args.json {
                print!("{}", table(group, &findings));
            }
            all.extend(findings);
        }
    }
    let failed = all.iter().filter(|finding| !finding.is_passed()).count();
    if args.json {
        let findings: Vec<_> = all.iter().map(as_json).collect();
        println!("{:#}", json!({ "failed": failed, "findings": findings }));
    } else {
        println!("{} checks, {failed} failed", all.len());
    }
    Ok(if failed > 0 { EXIT_FAULTS } else { EXIT_DONE })
}

fn table(group: Group, findings: &[Finding]) -> String {
    let mut text = String::new();
    for finding in findings {
        let verdict = match (finding.limit, finding.is_passed()) {
            (None, _) => "",
            (_, true) => "ok",
            (_, false) => "FAILED",
        };
        let limit = finding.limit.map_or_else(String::new, |limit| format!("at most {limit:.2e}"));
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{verdict:6} {:17} {:21} {:12} {:.2e} {limit:16}  {}",
            group.name(),
            finding.backend,
            finding.integrator,
            finding.measured,
            finding.check,
        );
    }
    text
}

/// Numbers that JSON has not, of a check that was void, become null.
fn as_json(finding: &Finding) -> serde_json::Value {
    json!({
        "group": finding.group.name(),
        "check": finding.check,
        "backend": finding.backend,
        "integrator": finding.integrator,
        "measured": finding.measured,
        "limit": finding.limit,
        "passed": finding.is_passed(),
    })
}
