//! What is heard of a difference between sounds, and how sounds are compared by ear.

/// Errors that count as equal, each just noticeable: of a pitch [cents], of a T60 [1], of the level of a third
/// octave [dB], of the beginning of the first stroke and of a later one [s], and of the level of a stroke [dB].
///
/// 3 cents: Moore, J. Acoust. Soc. Am. 54 (1973). 3 %: below the difference limen of reverberation times of 5 %, ISO
/// 3382-1 (2009), table A.1. 1 dB: the difference limen of levels, Zwicker & Fastl, Psychoacoustics (1990), 7.1; half
/// of it for strokes, which are compared with each other. 2 ms: two clicks are heard in their order at 2 to 3 ms
/// (Hirsh, J. Acoust. Soc. Am. 31, 1959); a quarter of it where a gesture begins, which the player feels.
pub const JUST_NOTICEABLE: [f64; 6] = [3.0, 0.03, 1.0, 0.5e-3, 2e-3, 0.5];
/// Highest audible frequency [Hz]: modes and third octaves above it are not compared.
pub(crate) const HIGHEST_AUDIBLE: f64 = 20_000.0;
/// The shortest time that says anything about a sound [s], a period of the lowest audible pitch. A Hann window of this
/// length keeps partials 40 Hz apart; a stroke stands out from so long a time before it and has its level over so long
/// a time after its beginning; loudness is compared over this time and its first multiples.
pub(crate) const SHORTEST_SECONDS: f64 = 0.05;
/// Partials, strokes and stretches this much weaker than the strongest are not compared [power].
pub(crate) const QUIET_POWER_RATIO: f64 = 1e-4;
/// Third octaves are compared if their power is above this part of the strongest one's.
pub(super) const COMPARED_POWER_MIN: f64 = 1e-6;
/// A band or stroke that is missing is compared as if it had this power, relative to the reference.
pub(super) const MISSING_POWER_RATIO: f64 = 1e-10;
/// An output sounds from where it has moved by this part of its largest motion (-120 dB): a gesture may take seconds
/// to reach what sounds.
pub(super) const MOTION_START_SHARE: f64 = 1e-6;
/// What differs from the mean by less than this share of the largest position is rounding, and no sound.
pub(super) const MEAN_ROUNDING_SHARE: f64 = 1e-14;
/// Most partials that are compared.
pub(super) const PARTIALS_MAX: usize = 5;
/// Time from window to window in which partials are followed [s].
pub(super) const PARTIALS_HOP: f64 = 5e-3;
/// Windows that overlap by half, the nearest that say different things, are so many hops apart.
pub(super) const WINDOWS_APART: usize = 5;
/// A difference of pitch is one if it exceeds this many of its standard deviations: 95 % of those that chance makes are
/// smaller.
pub(super) const SIGNIFICANT_DEVIATIONS: f64 = 2.0;
/// Angles have a common direction if their number times the square of their mean resultant length is more: that of
/// chance is in 5 % of cases, -ln 0.05.
pub(super) const RAYLEIGH_MIN: f64 = 3.0;
/// What is enough where they are too few for the test, as in a partial that fades within two windows: turns that scatter
/// by less than 0.5 rad.
pub(super) const COMMON_ANGLE_SHARE: f64 = 0.8;
/// A decay is compared only if a straight line fits its level this closely (rms) [nepers]: a partial that beats, or that a
/// contact stops, has no T60. The accuracy tests, whose bands have another shape, compare up to 0.1, so a plan has to
/// compare more.
pub(super) const DECAY_FIT_MAX: f64 = 0.15;
/// A decay is compared only if the level falls by at least this much [nepers]; 0.1 in the accuracy tests.
pub(super) const DECAY_FALL_MIN: f64 = 0.08;
/// Fewest windows from which a pitch is measured.
pub(super) const WINDOWS_MIN: usize = 8;
/// Power, in which strokes begin, is taken over so long a time [s].
pub(super) const STROKES_HOP: f64 = 1e-3;
/// A stroke begins where the power exceeds all that was there in the `SHORTEST_SECONDS` before by this factor.
pub(super) const ONSET_POWER_RATIO: f64 = 4.0;
/// How far before and after its beginning in the reference a stroke is looked for [s].
pub(super) const ONSET_SEARCH_SECONDS: f64 = 0.01;
/// The part of the energy within `ONSET_SEARCH_SECONDS` that marks the beginning of a stroke.
pub(super) const ONSET_ENERGY_SHARE: f64 = 0.3;
/// A sound that fades out is divided into this many parts; the last is its fade-out.
pub(super) const FADE_OUT_PARTS: usize = 4;
/// Least width × duration of a band: its level is the mean of about as many independent values. Two runs of one motion
/// have the same values, so one is enough.
pub(super) const BAND_VALUES_MIN: f64 = 1.0;
/// The same for runs that have parted: with fewer values the level is chance (two runs that differ by rounding alone
/// are then 2 to 4 dB apart).
pub(super) const BAND_VALUES_MIN_PARTED: f64 = 8.0;
/// The lowest third octave, of centre 1 kHz times 2^(i/3): 25 Hz.
pub(super) const LOWEST_THIRD_OCTAVE: i32 = -16;
/// Third octaves end at this part of the rate, or at `HIGHEST_AUDIBLE` if that is lower.
pub(super) const HIGHEST_BAND_RATE_SHARE: f64 = 0.45;
