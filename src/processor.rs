//! Whether this machine's processor has the instructions that this build uses: to be asked before anything else.

use std::sync::atomic::{AtomicU8, Ordering};

/// What there is to say to a person if [`suits`] is false.
pub const MESSAGE: &str = "this build of helmholtz needs a processor with AVX2 (Intel from 2013, AMD from 2015 on); for older ones build it with RUSTFLAGS=\"-C target-cpu=x86-64\"";

/// Whether the processor has what `.cargo/config.toml` compiled this library for. The standard library's own check is settled at
/// compile time, and so of no use here.
pub fn suits() -> bool {
    const UNKNOWN: u8 = 2;
    // Asking the processor is slow, in a virtual machine as slow as thousands of instructions.
    static KNOWN: AtomicU8 = AtomicU8::new(UNKNOWN);
    match KNOWN.load(Ordering::Relaxed) {
        UNKNOWN => {
            let suits = ask();
            KNOWN.store(u8::from(suits), Ordering::Relaxed);
            suits
        }
        known => known == 1,
    }
}

#[cold]
fn ask() -> bool {
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
