//! A row: one tick of the physics, packed as its index and then each axis.

/// Bits of [`Sample::flags`].
pub mod flag {
    /// The position came from the device since the previous tick; otherwise an older position was held.
    pub const FRESH: u8 = 1;
    /// A hand touched the key.
    pub const TOUCH: u8 = 2;
    /// The device let force through.
    pub const FORCE_ENABLED: u8 = 4;
    /// The stand-in played, not a person.
    pub const STAND_IN: u8 = 8;
    /// The safety limiter had tripped.
    pub const TRIPPED: u8 = 16;
}

/// One axis at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Position that the physics consumed [m].
    pub position: f64,
    /// Force that the key felt [N].
    pub force: f64,
    /// Force sent to the device, after the safety stages [N]; no wire carries more than single precision.
    pub sent: f32,
    /// Bits of [`flag`].
    pub flags: u8,
    /// The device's own clock, as it was sent; it wraps.
    pub clock: u32,
}

const INDEX: usize = 8;
const SAMPLE: usize = 8 + 8 + 4 + 1 + 4;

/// Bytes of a row.
pub(super) const fn size(n_axes: usize) -> usize {
    INDEX + n_axes * SAMPLE
}

/// Fill `to`, of [`size`] bytes.
pub(super) fn encode(to: &mut [u8], tick: u64, samples: &[Sample]) {
    let (tick_bytes, sample_bytes) = to.split_at_mut(INDEX);
    tick_bytes.copy_from_slice(&tick.to_le_bytes());
    for (to, sample) in sample_bytes.chunks_exact_mut(SAMPLE).zip(samples) {
        to[0..8].copy_from_slice(&sample.position.to_le_bytes());
        to[8..16].copy_from_slice(&sample.force.to_le_bytes());
        to[16..20].copy_from_slice(&sample.sent.to_le_bytes());
        to[20] = sample.flags;
        to[21..25].copy_from_slice(&sample.clock.to_le_bytes());
    }
}

/// The index of a row.
pub(super) fn tick(row: &[u8]) -> u64 {
    u64::from_le_bytes(eight(&row[..INDEX]))
}

/// The axes of a row.
pub(super) fn samples(row: &[u8]) -> impl Iterator<Item = Sample> {
    row[INDEX..].chunks_exact(SAMPLE).map(|from| Sample {
        position: f64::from_le_bytes(eight(&from[0..8])),
        force: f64::from_le_bytes(eight(&from[8..16])),
        sent: f32::from_le_bytes([from[16], from[17], from[18], from[19]]),
        flags: from[20],
        clock: u32::from_le_bytes([from[21], from[22], from[23], from[24]]),
    })
}

fn eight(bytes: &[u8]) -> [u8; 8] {
    let mut eight_bytes = [0; 8];
    eight_bytes.copy_from_slice(bytes);
    eight_bytes
}
