//! A row: one tick of the physics, packed as its index and then each axis.

/// Bits of [`RecordedSample::flags`].
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
pub struct RecordedSample {
    /// Position that the physics consumed [m].
    pub position: f64,
    /// Force that the key felt [N].
    pub force: f64,
    /// Force sent to the device, after the safety stages [N]; no wire carries more than single precision.
    pub sent_force: f32,
    /// Bits of [`flag`].
    pub flags: u8,
    /// The device's own clock, as it was sent; it wraps.
    pub clock: u32,
}

const TICK_BYTES: usize = 8;
const SAMPLE_BYTES: usize = 8 + 8 + 4 + 1 + 4;

/// Bytes of a row.
pub(super) const fn row_bytes(n_axes: usize) -> usize {
    TICK_BYTES + n_axes * SAMPLE_BYTES
}

/// Fill `row_bytes`, of [`row_bytes`] bytes.
pub(super) fn encode(row_bytes: &mut [u8], tick: u64, samples: &[RecordedSample]) {
    let (tick_bytes, sample_bytes) = row_bytes.split_at_mut(TICK_BYTES);
    tick_bytes.copy_from_slice(&tick.to_le_bytes());
    for (bytes, sample) in sample_bytes.chunks_exact_mut(SAMPLE_BYTES).zip(samples) {
        bytes[0..8].copy_from_slice(&sample.position.to_le_bytes());
        bytes[8..16].copy_from_slice(&sample.force.to_le_bytes());
        bytes[16..20].copy_from_slice(&sample.sent_force.to_le_bytes());
        bytes[20] = sample.flags;
        bytes[21..25].copy_from_slice(&sample.clock.to_le_bytes());
    }
}

/// The index of a row.
pub(super) fn decode_tick(row: &[u8]) -> u64 {
    u64::from_le_bytes(to_array(&row[..TICK_BYTES]))
}

/// The axes of a row.
pub(super) fn decode_samples(row: &[u8]) -> impl Iterator<Item = RecordedSample> {
    row[TICK_BYTES..]
        .chunks_exact(SAMPLE_BYTES)
        .map(|row_bytes| RecordedSample {
            position: f64::from_le_bytes(to_array(&row_bytes[0..8])),
            force: f64::from_le_bytes(to_array(&row_bytes[8..16])),
            sent_force: f32::from_le_bytes([row_bytes[16], row_bytes[17], row_bytes[18], row_bytes[19]]),
            flags: row_bytes[20],
            clock: u32::from_le_bytes([row_bytes[21], row_bytes[22], row_bytes[23], row_bytes[24]]),
        })
}

fn to_array(bytes: &[u8]) -> [u8; 8] {
    let mut array = [0; 8];
    array.copy_from_slice(bytes);
    array
}
