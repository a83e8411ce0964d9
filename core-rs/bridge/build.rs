//! Stops the build with an explanation if git checked out the package's symbolic links as text files.

use std::path::Path;

const PARTS: [&str; 13] = [
    "api",
    "cli",
    "common",
    "exchange",
    "instruments",
    "lab",
    "live",
    "lsp",
    "notation",
    "rendering",
    "repl",
    "scores",
    "view",
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Read when the build script runs, not with env!: checkouts that share a target folder share the compiled script.
    let bridge = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let package = Path::new(&bridge).join("../python/ergon");
    for part in PARTS {
        assert!(
            package.join(part).is_dir(),
            "core-rs/python/ergon/{part} is not a link to {part}/. \
             Run `git config core.symlinks true && git checkout -- core-rs/python` \
             (on Windows: turn Developer Mode on first)."
        );
    }
}
