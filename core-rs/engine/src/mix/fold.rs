//! Filters from each channel of one loudspeaker layout to each channel of another.

use thiserror::Error;

/// Largest number of channels on either side.
pub const MAX_CHANNELS: usize = 1024;
/// Largest number of taps of a filter.
pub const MAX_TAPS: usize = 1 << 16;
/// Frames that are summed together: their sums stay in registers.
const TILE_FRAMES: usize = 16;
/// Frames that are processed before the past samples are moved to the front of their buffer.
const BLOCK_FRAMES: usize = 1024;

/// Why a fold cannot be built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum FoldError {
    /// No channels, or too many.
    #[error("a fold has 1 to {MAX_CHANNELS} channels on either side; here {0} to {1}")]
    Channels(usize, usize),
    /// No taps, too many taps, or a number of coefficients that is not n_in · n_out · n_taps.
    #[error("a fold needs n_in · n_out · n_taps coefficients, n_taps from 1 to {MAX_TAPS}; here {0} coefficients")]
    Taps(usize),
    /// A coefficient that is not finite.
    #[error("coefficients of a fold must be finite numbers")]
    NotFinite,
}

/// A filter from each input channel to each output channel, in direct form.
///
/// A sample is summed channel by channel and tap by tap, the most recent sample first, so its bits depend neither on
/// the size of blocks nor on the width of the machine's registers. Filters that are 0, and zeros at the ends of a
/// filter, cost nothing. After [`Fold::new`] nothing is allocated.
///
/// ```
/// use ergon_engine::mix::fold::Fold;
///
/// let mut fold = Fold::new(2, 1, &[1.0, 0.0, 0.0, 0.5])?; // the left as it is, the right a frame late
/// let mut out = [0.0; 2];
/// fold.process(&[1.0, 4.0, 10.0, 0.0], &mut out);
/// assert_eq!(out, [1.0, 12.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Fold {
    n_in: usize,
    n_out: usize,
    /// Number of past frames that a filter needs: n_taps − 1.
    n_past_frames: usize,
    /// Sorted by output channel, then by input channel.
    paths: Vec<FoldPath>,
    taps: Vec<f64>,
    /// Of each input channel: past samples, then the current block   (n_in, n_past_frames + BLOCK_FRAMES)
    input_lines: Vec<f64>,
    frame_sums: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct FoldPath {
    input_channel: usize,
    output_channel: usize,
    /// Number of zeros before its first tap that is not 0.
    delay_frames: usize,
    first_tap: usize,
    n_taps: usize,
}

impl Fold {
    /// A fold of `filters` (n_in, n_out, n_taps).
    ///
    /// # Errors
    /// [`FoldError`].
    pub fn new(n_in: usize, n_out: usize, filters: &[f64]) -> Result<Self, FoldError> {
        let channel_range = 1..=MAX_CHANNELS;
        if !channel_range.contains(&n_in) || !channel_range.contains(&n_out) {
            return Err(FoldError::Channels(n_in, n_out));
        }
        let n_taps = filters.len() / (n_in * n_out);
        if n_taps * n_in * n_out != filters.len() || !(1..=MAX_TAPS).contains(&n_taps) {
            return Err(FoldError::Taps(filters.len()));
        }
        if !filters.iter().all(|h| h.is_finite()) {
            return Err(FoldError::NotFinite);
        }
        let (mut paths, mut taps) = (Vec::new(), Vec::new());
        for output_channel in 0..n_out {
            for input_channel in 0..n_in {
                let first_tap = (input_channel * n_out + output_channel) * n_taps;
                let filter = &filters[first_tap..first_tap + n_taps];
                let Some(delay_frames) = filter.iter().position(|h| *h != 0.0) else {
                    continue;
                };
                let filter_end = filter.iter().rposition(|h| *h != 0.0).unwrap_or(delay_frames) + 1;
                paths.push(FoldPath {
                    input_channel,
                    output_channel,
                    delay_frames,
                    first_tap: taps.len(),
                    n_taps: filter_end - delay_frames,
                });
                taps.extend_from_slice(&filter[delay_frames..filter_end]);
            }
        }
        let n_past_frames = n_taps - 1;
        Ok(Self {
            n_in,
            n_out,
            n_past_frames,
            paths,
            taps,
            input_lines: vec![0.0; n_in * (n_past_frames + BLOCK_FRAMES)],
            frame_sums: vec![0.0; BLOCK_FRAMES],
        })
    }

    /// Number of input channels.
    pub fn n_in(&self) -> usize {
        self.n_in
    }

    /// Number of output channels.
    pub fn n_out(&self) -> usize {
        self.n_out
    }

    /// Number of output frames that are not silent after the last input frame.
    pub fn tail_frames(&self) -> usize {
        self.n_past_frames
    }

    /// Filter `input` (n_frames, n_in) into `output` (n_frames, n_out), which is overwritten.
    pub fn process(&mut self, input: &[f64], output: &mut [f64]) {
        let input = input.chunks(BLOCK_FRAMES * self.n_in);
        for (input, output) in input.zip(output.chunks_mut(BLOCK_FRAMES * self.n_out)) {
            self.process_block(input, output);
        }
    }

    fn process_block(&mut self, input: &[f64], output: &mut [f64]) {
        let n_frames = input.len() / self.n_in;
        let line_width = self.n_past_frames + BLOCK_FRAMES;
        for (frame, row) in input.chunks_exact(self.n_in).enumerate() {
            for (channel, x) in row.iter().enumerate() {
                self.input_lines[channel * line_width + self.n_past_frames + frame] = *x;
            }
        }
        let mut paths_left = self.paths.iter().peekable();
        for output_channel in 0..self.n_out {
            let output_sums = &mut self.frame_sums[..n_frames.next_multiple_of(TILE_FRAMES)];
            output_sums.fill(0.0);
            while let Some(fold_path) = paths_left.next_if(|fold_path| fold_path.output_channel == output_channel) {
                let channel_line =
                    &self.input_lines[fold_path.input_channel * line_width..(fold_path.input_channel + 1) * line_width];
                let path_taps = &self.taps[fold_path.first_tap..fold_path.first_tap + fold_path.n_taps];
                let line_start = self.n_past_frames - fold_path.delay_frames;
                for (tile, output_sums) in output_sums.chunks_exact_mut(TILE_FRAMES).enumerate() {
                    add_filtered(output_sums, channel_line, line_start + tile * TILE_FRAMES, path_taps);
                }
            }
            for (frame, sum) in output_sums[..n_frames].iter().enumerate() {
                output[frame * self.n_out + output_channel] = *sum;
            }
        }
        for channel in 0..self.n_in {
            let channel_line = &mut self.input_lines[channel * line_width..(channel + 1) * line_width];
            channel_line.copy_within(n_frames..n_frames + self.n_past_frames, 0);
        }
    }
}

/// Add the filtered signal of TILE_FRAMES frames, the first of which is at `start` in `line`.
fn add_filtered(sums: &mut [f64], line: &[f64], start: usize, taps: &[f64]) {
    let mut tile_sums = [0.0; TILE_FRAMES];
    tile_sums.copy_from_slice(sums);
    for (age, tap) in taps.iter().enumerate() {
        let delayed = &line[start - age..start - age + TILE_FRAMES];
        for (sum, x) in tile_sums.iter_mut().zip(delayed) {
            *sum += tap * x;
        }
    }
    sums.copy_from_slice(&tile_sums);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The defining sum, frame by frame, in the same order.
    fn plain(n_in: usize, n_out: usize, filters: &[f64], input: &[f64]) -> Vec<f64> {
        let n_taps = filters.len() / (n_in * n_out);
        let n_frames = input.len() / n_in;
        let mut output = vec![0.0; n_frames * n_out];
        for frame in 0..n_frames {
            for to in 0..n_out {
                for from in 0..n_in {
                    for tap_index in 0..n_taps.min(frame + 1) {
                        output[frame * n_out + to] += filters[(from * n_out + to) * n_taps + tap_index]
                            * input[(frame - tap_index) * n_in + from];
                    }
                }
            }
        }
        output
    }

    proptest! {
        #[test]
        fn fold_in_blocks_equals_the_direct_sum(
            (n_in, n_out, n_taps) in (1usize..4, 1usize..4, 1usize..40),
            seed in prop::collection::vec(-1.0..1.0f64, 5000),
            cuts in prop::collection::vec(0usize..1500, 0..4),
        ) {
            let mut filters = seed[..n_in * n_out * n_taps].to_vec();
            filters.iter_mut().step_by(3).for_each(|h| *h = 0.0);
            let n_frames = seed.len() / n_in;
            let input = &seed[..n_frames * n_in];
            let mut fold = Fold::new(n_in, n_out, &filters).expect("fold");
            let mut output = vec![f64::NAN; n_frames * n_out];
            let mut begin = 0usize;
            for cut in cuts.iter().copied().chain([usize::MAX]) {
                let end = n_frames.min(begin.saturating_add(cut));
                fold.process(&input[begin * n_in..end * n_in], &mut output[begin * n_out..end * n_out]);
                begin = end;
            }
            prop_assert_eq!(output, plain(n_in, n_out, &filters, input));
        }
    }

    #[test]
    fn fold_with_wrong_filters_is_refused() {
        assert_eq!(Fold::new(0, 1, &[]).err(), Some(FoldError::Channels(0, 1)));
        assert_eq!(Fold::new(2, 2, &[]).err(), Some(FoldError::Taps(0)));
        assert_eq!(Fold::new(2, 2, &[1.0; 6]).err(), Some(FoldError::Taps(6)));
        assert_eq!(Fold::new(1, 1, &[f64::NAN]).err(), Some(FoldError::NotFinite));
    }
}
