//! The `helmholtz` program: parses its arguments and hands them to [`helmholtz::cli`].

use std::process::ExitCode;

use clap::Parser;
use helmholtz::cli::{self, Cli};

fn main() -> ExitCode {
    if !processor_suits() {
        eprintln!(
            "this build of helmholtz needs a processor with AVX2 (Intel from 2013, AMD from 2015 on); for older ones build it with RUSTFLAGS=\"-C target-cpu=x86-64\""
        );
        return ExitCode::FAILURE;
    }
    cli::run(Cli::parse())
}

/// Whether the processor has what `.cargo/config.toml` compiled this program for. The standard library's own check is settled at
/// compile time, and so of no use here.
fn processor_suits() -> bool {
    #[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
    {
        use std::arch::x86_64::{__cpuid, __cpuid_count};
        const FMA: u32 = 1 << 12;
        const AVX2_BMI2: u32 = 1 << 5 | 1 << 8;
        if __cpuid(0).eax < 7 {
            return false;
        }
        __cpuid(1).ecx & FMA != 0 && __cpuid_count(7, 0).ebx & AVX2_BMI2 == AVX2_BMI2
    }
    #[cfg(not(all(target_arch = "x86_64", target_feature = "avx2")))]
    true
}
