//! Refuses, with a sentence, a checkout where the package's links arrived as text files.

use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../python/ergon");
    for part in ["cli", "exchange", "instruments", "lab", "scores", "view"] {
        assert!(
            package.join(part).is_dir(),
            "core-rs/python/ergon/{part} is not a link to {part}/. \
             Run `git config core.symlinks true && git checkout -- core-rs/python` \
             (on Windows: turn Developer Mode on first)."
        );
    }
}
