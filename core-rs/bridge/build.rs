//! Stops the build with an explanation if git checked out the package's symbolic links as text files.

use std::path::Path;

const LINKS: [&str; 4] = ["cli", "instruments", "repl", "scores"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Read when the build script runs, not with env!: checkouts that share a target folder share the compiled script.
    let bridge = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let package = Path::new(&bridge).join("../../ergon");
    for link in LINKS {
        assert!(
            package.join(link).is_dir(),
            "ergon/{link} is not a link to {link}/. \
             Run `git config core.symlinks true && git checkout -- ergon` \
             (on Windows: turn Developer Mode on first)."
        );
    }
}
