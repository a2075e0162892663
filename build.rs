//! With the feature `embree`: finds Embree 4, generates its bindings from the header that is installed, and links it.
//!
//! The bindings are made from that header and not shipped, because the layout of `RTCRayHit` depends on the version
//! (80 bytes before Embree 4.3, 96 since). See `vendor-notes/embree.md`.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "embree")]
    if let Err(message) = embree::build() {
        // A panic would bury the message under a backtrace of this script.
        eprintln!("\n{message}\n");
        std::process::exit(1);
    }
}

#[cfg(feature = "embree")]
mod embree {
    use std::env;
    use std::fs;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::path::{Path, PathBuf};

    /// All that `src/query/embree` uses; anything else stays out of the bindings.
    const FUNCTIONS: &[&str] = &[
        "rtc(New|Release)(Device|Geometry|Scene)",
        "rtcGetDevice(Error|Property)",
        "rtcSetDevice(Error|MemoryMonitor)Function",
        "rtcSetSharedGeometryBuffer",
        "rtcSetGeometry(UserData|UserPrimitiveCount|BuildQuality)",
        "rtcUpdateGeometryBuffer",
        "rtcSetGeometry(Bounds|Intersect|Occluded)Function",
        "rtcCommit(Geometry|Scene)",
        "rtcGetGeometry(BufferData)?",
        "rtcAttachGeometryByID",
        "rtcSetScene(BuildQuality|Flags)",
        "rtc(Forward)?(Intersect|Occluded)1",
    ];
    const TYPES: &[&str] = &[
        "RTC(Ray|Hit|RayHit|Bounds)",
        "RTC(Bounds|IntersectFunctionN|OccludedFunctionN)Arguments",
        "RTC(Device|Geometry|Scene)",
        "RTC(Error|DeviceProperty|GeometryType|BufferType|Format|BuildQuality|SceneFlags)",
    ];
    const CONSTANTS: &[&str] = &["RTC_VERSION(_MAJOR|_MINOR|_STRING)?"];

    /// Where an Embree 4 was found.
    struct Installation {
        include: PathBuf,
        library: PathBuf,
    }

    pub(super) fn build() -> Result<(), String> {
        println!("cargo::rerun-if-env-changed=EMBREE_DIR");
        println!("cargo::rerun-if-env-changed=HOME");
        let embree = find()?;
        check_version(&embree.include)?;
        link(&embree.library);
        generate_bindings(&embree.include)?;
        // The layout of the structs as a C compiler sees it, for a unit test.
        println!("cargo::rerun-if-changed=src/query/embree/layout.c");
        cc::Build::new()
            .file("src/query/embree/layout.c")
            .include(&embree.include)
            .try_compile("helmholtz_embree_layout")
            .map_err(|e| format!("src/query/embree/layout.c could not be compiled: {e}"))
    }

    fn find() -> Result<Installation, String> {
        let prefixes = if let Some(dir) = env::var_os("EMBREE_DIR") {
            vec![PathBuf::from(dir)]
        } else {
            let home = env::var_os("HOME").map(|home| Path::new(&home).join(".local"));
            ["/usr/local".into()].into_iter().chain(home).chain(["/usr".into()]).collect()
        };
        prefixes.iter().find_map(|prefix| installation_in(prefix)).ok_or_else(|| {
            let places: Vec<_> = prefixes.iter().map(|p| p.display().to_string()).collect();
            format!(
                "Embree 4 was not found in {} (include/embree4/rtcore.h and lib/libembree4.so).\n\
                 Install it:              vendor-notes/install-embree.sh\n\
                 or say where it is:      EMBREE_DIR=/its/prefix cargo build\n\
                 or build without it, on the pure-Rust backend alone:   cargo build --no-default-features",
                places.join(", ")
            )
        })
    }

    fn installation_in(prefix: &Path) -> Option<Installation> {
        let include = prefix.join("include");
        if !include.join("embree4/rtcore.h").is_file() {
            return None;
        }
        // Cargo sets the architecture for every build script.
        let multiarch = format!("lib/{}-linux-gnu", env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default());
        ["lib", "lib64", &multiarch]
            .into_iter()
            .map(|directory| prefix.join(directory))
            .find(|directory| directory.join("libembree4.so").exists())
            .map(|library| Installation { include, library })
    }

    fn check_version(include: &Path) -> Result<(), String> {
        let path = include.join("embree4/rtcore_config.h");
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let major = text.lines().find_map(|line| line.strip_prefix("#define RTC_VERSION_MAJOR "));
        match major.map(str::trim) {
            Some("4") => Ok(()),
            Some(other) => Err(format!(
                "{} is of Embree {other}; Helmholtz needs Embree 4.\n\
                 Install it with vendor-notes/install-embree.sh, or set EMBREE_DIR to the prefix of an Embree 4.",
                path.display()
            )),
            None => Err(format!("{} does not define RTC_VERSION_MAJOR", path.display())),
        }
    }

    fn link(library: &Path) {
        println!("cargo::rustc-link-search=native={}", library.display());
        println!("cargo::rustc-link-lib=dylib=embree4");
        // The loader knows the system's directories by itself; naming them in a run path would only overrule others.
        if !library.starts_with("/usr/lib") {
            println!("cargo::rustc-link-arg=-Wl,-rpath,{}", library.display());
        }
    }

    fn generate_bindings(include: &Path) -> Result<(), String> {
        let header = include.join("embree4/rtcore.h");
        let mut builder = bindgen::Builder::default()
            .header(header.display().to_string())
            .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()))
            .prepend_enum_name(false)
            .derive_default(true)
            .generate_comments(false)
            .allowlist_recursively(true);
        for function in FUNCTIONS {
            builder = builder.allowlist_function(function);
        }
        for ty in TYPES {
            builder = builder.allowlist_type(ty);
        }
        for constant in CONSTANTS {
            builder = builder.allowlist_var(constant);
        }
        let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("cargo did not set OUT_DIR")?).join("embree.rs");
        // bindgen panics where libclang is missing, and with a message that says little about what to install.
        catch_unwind(AssertUnwindSafe(|| builder.generate()))
            .map_err(|_| {
                "bindgen could not load libclang. Install it: vendor-notes/install-embree.sh".to_owned()
            })?
            .map_err(|e| format!("bindgen failed on {}: {e}", header.display()))?
            .write_to_file(&out)
            .map_err(|e| format!("{}: {e}", out.display()))
    }
}
