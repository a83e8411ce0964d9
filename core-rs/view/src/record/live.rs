//! Chunks of a single look for live pages; for a file, chunks wait until a second is complete.

use super::Recorder;
use crate::frames::PartFrames;
use crate::payload::{ByteWriter, kind, write_chunk};

/// The chunks of one look.
#[derive(Debug, Default)]
pub struct LiveChunks {
    /// Whether they contain a key state: a new viewer can begin here.
    pub has_key_state: bool,
    /// Chunks that matter whatever comes later.
    pub events: Vec<u8>,
    /// Chunks that only matter until the next look.
    pub latest: Vec<u8>,
}

impl Recorder {
    /// The chunks of the last look, for live pages; used instead of those of a file.
    pub fn take_live(&mut self) -> LiveChunks {
        let mut segment = std::mem::take(&mut self.segment);
        let look_time = self.last_look;
        let has_key_state = (self.look_number.wrapping_sub(1)).is_multiple_of(self.looks_per_segment());
        let (mut events, mut latest) = (Vec::new(), Vec::new());
        (segment.events).sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let now_index = segment.events.partition_point(|event| event.0 < look_time);
        let (past_events, now_events) = segment.events.split_at(now_index);
        let mut put_chunks = |timed_events: &[(f64, u16, ByteWriter)], state_bytes: Option<&ByteWriter>| {
            if let Some(state_bytes) = state_bytes {
                write_chunk(&mut events, kind::STATE, look_time, &state_bytes.0);
            }
            for (seconds, kind, payload) in timed_events {
                let target_chunks = match *kind {
                    kind::LEVELS | kind::HANDS => &mut latest,
                    _ => &mut events,
                };
                write_chunk(target_chunks, *kind, *seconds, &payload.0);
            }
        };
        put_chunks(past_events, None);
        put_chunks(now_events, has_key_state.then_some(&segment.state_bytes));
        let mut peak_bytes = ByteWriter::default();
        self.output_peaks.iter().for_each(|peak| peak_bytes.f32(*peak));
        write_chunk(&mut latest, kind::PEAKS, look_time, &peak_bytes.0);
        for (part, rows) in segment.sampled_displacements.into_iter().enumerate() {
            if self.runs[part].kind == "sampled" {
                let live_frames = PartFrames {
                    part: part as u16,
                    frame_interval: 1.0 / self.setup.looks_per_second,
                    rows,
                    n_frames: 1,
                };
                write_chunk(&mut latest, kind::FRAMES, look_time, &live_frames.plain_payload());
            }
        }
        LiveChunks {
            has_key_state,
            events,
            latest,
        }
    }
}
