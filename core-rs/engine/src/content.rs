//! What the sound of islands and banks up to an instant depends on, as hashes: equal ones sound equal.

pub(crate) mod bank;
pub(crate) mod island;

use std::fmt::{self, Arguments, Write};

use sha2::{Digest, Sha256};

use crate::network::{Network, PartOrder};

/// A writer that hashes what is written.
pub(crate) struct Hasher(Sha256);

impl Hasher {
    pub(crate) fn new() -> Self {
        Self(Sha256::new())
    }

    pub(crate) fn add(&mut self, bytes: impl AsRef<[u8]>) {
        self.0.update(bytes);
    }

    pub(crate) fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

impl Write for Hasher {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text);
        Ok(())
    }
}

/// A hash of a network without its names, and of the text `other_inputs` (64 hex digits).
pub(crate) fn network_key(network: &Network, other_inputs: Arguments<'_>) -> String {
    let network = network.anonymous(&PartOrder::new([network]));
    hash_hex(format_args!("{network:?}\n{other_inputs}"))
}

/// A hash of formatted text (64 hex digits).
pub(crate) fn hash_hex(formatted_text: Arguments<'_>) -> String {
    hex(&digest(formatted_text))
}

/// The hex digits of a hash.
pub(crate) fn hex(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn digest(text: Arguments<'_>) -> [u8; 32] {
    let mut hasher = Hasher::new();
    // Writing into a hash cannot fail.
    let _ = hasher.write_fmt(text);
    hasher.finish()
}
