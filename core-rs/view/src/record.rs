//! Records a simulation as chunks: it is looked at once a video frame, and data that a reader can compute by itself are
//! not written.
//!
//! A reader continues free oscillations by itself. The recorder computes them in the same way, and writes a new one, a
//! flight, only if the engine differs from it: after an ergon, from the instant of the ergon on.

use std::collections::HashMap;
use std::ops::Range;

use ergon_engine::simulation::{ContactPush, ErgonRecord, MotionLook, MotionSnapshot, PointMotion, Simulation};

use crate::bundle::{self, UnpackedTotal};
use crate::frames::PartFrames;
use crate::motion::{MAGIC, PAYLOAD_MAX};
use crate::payload::{ByteWriter, kind, write_chunk};
use flights::Flight;
use parts::{OscillatingTrack, oscillating_tracks, strike_times};

mod flights;
mod live;
mod parts;
mod tables;

pub use live::LiveChunks;
pub use parts::{PointRun, point_runs};

/// Written ergons are reported this long before they strike [s].
const REPORT_AHEAD_SECONDS: f64 = 1.0;
/// Ergons that struck at most this long before the first look are reported as well [s]: a live page goes back no
/// further.
const REPORT_BACK_SECONDS: f64 = 5.0;

/// Settings of a recording: everything besides the motion itself.
#[derive(Clone, Debug)]
pub struct RecordingSetup {
    /// The manifest, as JSON.
    pub manifest: String,
    /// Position of each point [m]   (n_points)
    pub point_positions: Vec<[f64; 3]>,
    /// Ergons that are known beforehand, by rising instant.
    pub ergons: Vec<ErgonRecord>,
    /// MATs that may be struck live, by the number of their point in the timeline.
    pub strike_points: HashMap<u32, usize>,
    /// The MAT of each key, by its number in the timeline.
    pub key_mats: Vec<usize>,
    /// Number of loudspeakers.
    pub n_speakers: usize,
    /// Looks a second [Hz].
    pub looks_per_second: f64,
}

/// One second of chunks, which are written when it is over.
#[derive(Default)]
struct Segment {
    start: f64,
    state_bytes: ByteWriter,
    /// Displacements of each run that is sampled   (count · n)
    sampled_displacements: Vec<Vec<f64>>,
    n_frames: usize,
    events: Vec<(f64, u16, ByteWriter)>,
}

/// Records a simulation as chunks.
pub struct Recorder {
    look: MotionLook,
    setup: RecordingSetup,
    rate: f64,
    runs: Vec<PointRun>,
    tracks: Vec<OscillatingTrack>,
    /// (n_tracks)
    flights: Vec<Flight>,
    /// Rising instants of the strikes on each point, and after these on each body.
    strike_times: Vec<Vec<f64>>,
    /// Reused by [`Recorder::look`] for every look.
    snapshot: MotionSnapshot,
    /// Displacements of the points of modal parts, as of their last evaluation   (n_points)
    modal_displacements: Vec<f64>,
    output_peaks: Vec<f64>,
    /// Least and largest displacement so far of each point that is sampled   (n_points)
    extremes: Vec<(f64, f64)>,
    /// Index of the point of each MAT.
    point_by_mat: HashMap<usize, usize>,
    look_number: u64,
    /// Instant of the simulation at which the recording begins [s]: ergons written before it did not strike in the
    /// simulation.
    record_start: f64,
    last_look: f64,
    n_reported_ergons: usize,
    /// Index in the table of links of each breakable link; `None` unless both its ends are seen.
    link_numbers: Vec<Option<u32>>,
    /// Instant at which each was first seen broken [s].
    break_times: Vec<Option<f64>>,
    /// Live strikes that are not reported yet: instant [s], point of the file, impulse [N·s].
    live_strikes: Vec<(f64, u32, f64)>,
    level_square_sums: Vec<f64>,
    n_level_frames: u64,
    segment: Segment,
    segment_offsets: Vec<(f64, u64)>,
    pending_bytes: Vec<u8>,
    /// Number of bytes taken so far.
    bytes_taken: u64,
    /// What the bundles of the file hold so far; `None` live, where there are none.
    unpacked_total: Option<UnpackedTotal>,
}

impl Recorder {
    /// A recorder that begins a file with its manifest and tables.
    ///
    /// # Errors
    /// A sentence if a table is too long.
    pub fn new(simulation: &Simulation, look: MotionLook, setup: RecordingSetup) -> Result<Self, String> {
        Self::begin(simulation, look, setup, Some(UnpackedTotal::default()))
    }

    /// A recorder for live pages, which begins with manifest and tables as well.
    ///
    /// # Errors
    /// A sentence if a table is too long.
    pub fn for_live_pages(simulation: &Simulation, look: MotionLook, setup: RecordingSetup) -> Result<Self, String> {
        Self::begin(simulation, look, setup, None)
    }

    fn begin(
        simulation: &Simulation,
        look: MotionLook,
        setup: RecordingSetup,
        unpacked: Option<UnpackedTotal>,
    ) -> Result<Self, String> {
        let network = simulation.network();
        let runs = point_runs(&look);
        if setup.point_positions.len() != look.points.len() {
            return Err(format!(
                "{} places for {} points",
                setup.point_positions.len(),
                look.points.len()
            ));
        }
        if runs.len() >= usize::from(u16::MAX) || 48 * look.points.len() > PAYLOAD_MAX {
            return Err("a motion file holds a million masses at most".into());
        }
        let point_by_mat: HashMap<usize, usize> = (look.points.iter().enumerate())
            .map(|(point_index, point)| (point.mat, point_index))
            .collect();
        let strike_times = strike_times(&look, network, &point_by_mat, &setup.ergons, simulation.rate());
        let n_tracks = look.n_tracks();
        let mut recorder = Self {
            tracks: oscillating_tracks(&look, &runs),
            flights: vec![Flight::default(); n_tracks],
            strike_times,
            snapshot: MotionSnapshot::new(simulation, &look),
            modal_displacements: vec![0.0; look.points.len()],
            output_peaks: vec![0.0; runs.len()],
            extremes: vec![(f64::INFINITY, f64::NEG_INFINITY); look.points.len()],
            point_by_mat,
            rate: simulation.rate(),
            look_number: 0,
            record_start: simulation.frame() as f64 / simulation.rate(),
            last_look: 0.0,
            n_reported_ergons: 0,
            link_numbers: tables::breakable_numbers(&look, network),
            break_times: vec![None; look.breakable_links.len()],
            live_strikes: Vec::new(),
            level_square_sums: vec![0.0; setup.n_speakers],
            n_level_frames: 0,
            segment: Segment::default(),
            segment_offsets: Vec::new(),
            pending_bytes: MAGIC.to_vec(),
            bytes_taken: 0,
            unpacked_total: unpacked,
            runs,
            look,
            setup,
        };
        let (mut table_chunks, look_and_setup) = (Vec::new(), (&recorder.look, &recorder.setup));
        tables::write_tables(&mut table_chunks, network, look_and_setup, &recorder.runs);
        if table_chunks.len() > PAYLOAD_MAX {
            return Err("the tables of this piece are too long for a motion file".into());
        }
        if recorder.unpacked_total.is_some() {
            tables::write_maker(&mut recorder.pending_bytes, &recorder.setup.manifest);
        }
        recorder.write_bundle(0.0, &table_chunks);
        Ok(recorder)
    }

    /// The instant of a frame [s].
    pub fn seconds(&self, frame: u64) -> f64 {
        frame as f64 / self.rate
    }

    /// The frame of the simulation at which the next look is due.
    pub fn next_frame(&self) -> u64 {
        (self.look_number as f64 * self.rate / self.setup.looks_per_second + 0.5) as u64
    }

    /// Look at the simulation as it is now.
    pub fn record_look(&mut self, simulation: &mut Simulation) {
        let mut snapshot = std::mem::take(&mut self.snapshot);
        simulation.fill_snapshot(&self.look, &mut snapshot);
        self.record(&snapshot);
        self.snapshot = snapshot;
    }

    /// Record the next glance.
    pub fn record(&mut self, snapshot: &MotionSnapshot) {
        let look_time = self.seconds(snapshot.frame);
        let is_first = self.look_number.is_multiple_of(self.looks_per_segment());
        if self.look_number == 0 {
            // If the recording begins later than the simulation, there was a frame before the first look.
            self.last_look = (look_time - 1.0 / self.setup.looks_per_second).max(0.0);
            // The instant of a strike may be up to half a frame before the frame in which it acts.
            let report_start = (self.record_start - 0.5 / self.rate).max(look_time - REPORT_BACK_SECONDS);
            self.n_reported_ergons = (self.setup.ergons).partition_point(|ergon| ergon.time < report_start);
        }
        self.write_flights(&snapshot.tracks, look_time, is_first);
        self.write_contacts(&snapshot.pushes);
        self.write_sparks(snapshot.sparks());
        if is_first {
            self.end_segment();
            self.begin_segment(look_time);
        }
        self.record_sampled(&snapshot.tracks);
        self.write_breaks(&snapshot.is_broken, look_time, is_first);
        self.write_upcoming_ergons(look_time);
        self.write_live_strikes(look_time);
        self.write_hands(snapshot, look_time);
        self.write_levels(look_time);
        self.last_look = look_time;
        self.look_number += 1;
    }

    fn looks_per_segment(&self) -> u64 {
        ((self.setup.looks_per_second + 0.5) as u64).max(1)
    }

    /// Take the signals of the loudspeakers since the last look   (n_frames · n_speakers)
    pub fn add_levels(&mut self, samples: &[f64]) {
        self.n_level_frames += add_square_sums(&mut self.level_square_sums, samples);
    }

    /// Take the sums of the squares of `n_frames` frames   (n_speakers)
    pub fn add_squared_levels(&mut self, square_sums: &[f64], n_frames: u64) {
        for (square_sum, added_sum) in self.level_square_sums.iter_mut().zip(square_sums) {
            *square_sum += added_sum;
        }
        self.n_level_frames += n_frames;
    }

    /// The bytes completed since the last call.
    pub fn take_bytes(&mut self) -> Vec<u8> {
        self.bytes_taken += self.pending_bytes.len() as u64;
        std::mem::take(&mut self.pending_bytes)
    }

    /// The last bytes: the current segment, and the index.
    pub fn finish(&mut self) -> Vec<u8> {
        self.end_segment();
        let index_offset = self.bytes_taken + self.pending_bytes.len() as u64;
        let mut index_bytes = ByteWriter::default();
        index_bytes.u32(self.segment_offsets.len() as u32);
        index_bytes.u32(self.output_peaks.len() as u32);
        index_bytes.f64(self.last_look);
        self.output_peaks.iter().for_each(|peak| index_bytes.f32(*peak));
        for &(seconds, segment_offset) in &self.segment_offsets {
            index_bytes.f64(seconds);
            index_bytes.u64(segment_offset);
        }
        index_bytes.u64(index_offset);
        write_chunk(&mut self.pending_bytes, kind::INDEX, self.last_look, &index_bytes.0);
        self.take_bytes()
    }

    fn event_bytes(&mut self, seconds: f64, kind: u16) -> &mut ByteWriter {
        let segment_events = &mut self.segment.events;
        let has_same_key = |last_event: &(f64, u16, ByteWriter)| (last_event.0, last_event.1) == (seconds, kind);
        if !segment_events.last().is_some_and(has_same_key) {
            segment_events.push((seconds, kind, ByteWriter::default()));
        }
        let last_index = segment_events.len() - 1;
        &mut segment_events[last_index].2
    }

    /// Pushes of contacts since the last look.
    fn write_contacts(&mut self, pushes: &[ContactPush]) {
        let (last_look, frame_rate) = (self.last_look, self.rate);
        let all_pushes = pushes.iter().enumerate();
        for (contact, push) in all_pushes.filter(|(_, push)| push.force != 0.0) {
            let contact_bytes = self.event_bytes(last_look, kind::CONTACTS);
            contact_bytes.f32(push.frame as f64 / frame_rate - last_look);
            contact_bytes.u32(contact as u32);
            contact_bytes.f32(push.force);
        }
    }

    /// Strikes of written hands since the last look; at the first look, since the recording began.
    fn write_sparks(&mut self, sparks: &[ErgonRecord]) {
        let (last_look, record_start) = (self.last_look, self.record_start - 0.5 / self.rate);
        for spark in sparks.iter().filter(|spark| spark.time >= record_start) {
            if let Some(&point_index) = self.point_by_mat.get(&(spark.mat as usize)) {
                write_ergon(
                    self.event_bytes(last_look, kind::ERGONS),
                    spark.time - last_look,
                    point_index,
                    spark,
                );
            }
        }
    }

    /// Links that broke since the last look; together with a key state, all that are broken.
    fn write_breaks(&mut self, broken: &[bool], now: f64, is_first: bool) {
        for (index, _) in broken.iter().enumerate().filter(|(_, is_broken)| **is_broken) {
            let is_new_break = self.break_times[index].is_none();
            let break_time = *self.break_times[index].get_or_insert(now);
            let Some(link_index) = self.link_numbers[index] else {
                continue;
            };
            if is_new_break || is_first {
                let break_bytes = self.event_bytes(now, kind::BROKEN);
                break_bytes.f32(break_time - now);
                break_bytes.u32(link_index);
            }
        }
    }

    fn record_sampled(&mut self, displacements: &[f64]) {
        self.segment.sampled_displacements.resize(self.runs.len(), Vec::new());
        let run_buffers = self
            .runs
            .iter()
            .zip(&mut self.segment.sampled_displacements)
            .zip(&mut self.output_peaks);
        for ((run, rows), peak) in run_buffers.filter(|((run, _), _)| run.kind == "sampled") {
            let point_row = &displacements[run.points.clone()];
            *peak = point_row.iter().fold(*peak, |peak, x| peak.max(x.abs()));
            let extremes = &mut self.extremes[run.points.clone()];
            for ((low, high), x) in extremes.iter_mut().zip(point_row) {
                (*low, *high) = (low.min(*x), high.max(*x));
            }
            rows.extend_from_slice(point_row);
        }
        self.segment.n_frames += 1;
    }

    /// Ergons that will strike within the next second; at the first look, also those that have struck before it.
    fn write_upcoming_ergons(&mut self, now: f64) {
        while let Some(ergon) = self.setup.ergons.get(self.n_reported_ergons).copied() {
            if ergon.time >= now + REPORT_AHEAD_SECONDS {
                break;
            }
            self.n_reported_ergons += 1;
            let Some(&point_index) = self.point_by_mat.get(&(ergon.mat as usize)) else {
                continue;
            };
            write_ergon(
                self.event_bytes(now, kind::ERGONS),
                ergon.time - now,
                point_index,
                &ergon,
            );
        }
    }

    /// Take a live strike that happened at `seconds`. It is reported with the next look; its speed is unknown.
    pub fn add_strike(&mut self, seconds: f64, point: u32, impulse: f64) {
        let struck_mat = self.setup.strike_points.get(&point);
        if let Some(&point_index) = struck_mat.and_then(|struck_mat| self.point_by_mat.get(struck_mat)) {
            self.live_strikes.push((seconds, point_index as u32, impulse));
        }
    }

    fn write_live_strikes(&mut self, now: f64) {
        for (seconds, point, impulse) in std::mem::take(&mut self.live_strikes) {
            if seconds < now - REPORT_BACK_SECONDS {
                continue;
            }
            let ergon_bytes = self.event_bytes(now, kind::ERGONS);
            ergon_bytes.f32(seconds - now);
            ergon_bytes.u32(point);
            ergon_bytes.f32(impulse);
            ergon_bytes.f32(f64::NAN);
            ergon_bytes.u32(u32::MAX);
        }
    }

    fn write_hands(&mut self, snapshot: &MotionSnapshot, now: f64) {
        if self.setup.key_mats.is_empty() {
            return;
        }
        let key_states: Vec<(f64, f64)> = (self.setup.key_mats.iter().enumerate())
            .map(|(key, mat)| {
                let key_point = self
                    .point_by_mat
                    .get(mat)
                    .map(|&index| (index, &self.look.points[index]));
                let key_position = match key_point {
                    Some((_, point)) if matches!(point.motion, PointMotion::NotComputed { .. }) => f64::NAN,
                    Some((point_index, point)) => snapshot.tracks[point_index] + point.rest,
                    None => f64::NAN,
                };
                (
                    key_position,
                    snapshot.gesture_positions.get(key).copied().unwrap_or(f64::NAN),
                )
            })
            .collect();
        let hand_bytes = self.event_bytes(now, kind::HANDS);
        for (key, (key_position, gesture_position)) in key_states.into_iter().enumerate() {
            hand_bytes.u32(key as u32);
            hand_bytes.f32(key_position);
            hand_bytes.f32(gesture_position);
        }
    }

    fn write_levels(&mut self, now: f64) {
        if self.n_level_frames == 0 {
            return;
        }
        let frames_heard = self.n_level_frames as f64;
        let square_sums = std::mem::replace(&mut self.level_square_sums, vec![0.0; self.setup.n_speakers]);
        self.n_level_frames = 0;
        let level_bytes = self.event_bytes(now, kind::LEVELS);
        square_sums
            .iter()
            .for_each(|square_sum| level_bytes.f32((square_sum / frames_heard).sqrt()));
    }

    /// Write complete chunks: in a file as a bundle.
    fn write_bundle(&mut self, seconds: f64, chunks: &[u8]) {
        match &mut self.unpacked_total {
            Some(unpacked) => {
                bundle::write_bundle(&mut self.pending_bytes, seconds, chunks, self.bytes_taken, unpacked)
            }
            None => self.pending_bytes.extend_from_slice(chunks),
        }
    }

    /// Write the current segment.
    fn end_segment(&mut self) {
        let mut segment = std::mem::take(&mut self.segment);
        if segment.n_frames == 0 {
            // Events before the first look stay for its segment.
            self.segment.events = segment.events;
            return;
        }
        self.segment_offsets
            .push((segment.start, self.bytes_taken + self.pending_bytes.len() as u64));
        let mut bundle_chunks = Vec::new();
        write_chunk(&mut bundle_chunks, kind::STATE, segment.start, &segment.state_bytes.0);
        let mut peak_bytes = ByteWriter::default();
        self.output_peaks.iter().for_each(|peak| peak_bytes.f32(*peak));
        write_chunk(&mut bundle_chunks, kind::PEAKS, segment.start, &peak_bytes.0);
        segment.events.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (seconds, kind, payload) in &segment.events {
            write_chunk(&mut bundle_chunks, *kind, *seconds, &payload.0);
        }
        self.write_bundle(segment.start, &bundle_chunks);
        self.write_frames(&segment);
    }

    /// Write the frames of a segment.
    fn write_frames(&mut self, segment: &Segment) {
        for (run_index, (run, rows)) in self.runs.iter().zip(&segment.sampled_displacements).enumerate() {
            // Split into chunks of the largest possible number of frames.
            for frame_range in chunks(segment.n_frames, (PAYLOAD_MAX / 16) / run.points.len().max(1)) {
                if run.kind != "sampled" {
                    break;
                }
                let point_count = run.points.len();
                let extremes = &self.extremes[run.points.clone()];
                let amplitudes: Vec<f64> = extremes.iter().map(|(low, high)| 0.5 * (high - low)).collect();
                let run_frames = PartFrames {
                    part: run_index as u16,
                    frame_interval: 1.0 / self.setup.looks_per_second,
                    rows: rows[frame_range.start * point_count..frame_range.end * point_count].to_vec(),
                    n_frames: frame_range.len(),
                };
                let chunk_start = segment.start + frame_range.start as f64 / self.setup.looks_per_second;
                write_chunk(
                    &mut self.pending_bytes,
                    kind::FRAMES,
                    chunk_start,
                    &run_frames.packed_payload(&amplitudes),
                );
            }
        }
    }
}

fn write_ergon(out: &mut ByteWriter, time_offset: f64, point: usize, ergon: &ErgonRecord) {
    out.f32(time_offset);
    out.u32(point as u32);
    out.f32(ergon.impulse);
    out.f32(ergon.speed);
    out.u32(ergon.source);
}

/// Add the squares of the signals to the sums of the loudspeakers; returns the number of frames.
pub fn add_square_sums(square_sums: &mut [f64], samples: &[f64]) -> u64 {
    let mixed_frames = samples.chunks_exact(square_sums.len().max(1));
    let frame_count = mixed_frames.len() as u64;
    for frame in mixed_frames {
        for (square_sum, channel_sample) in square_sums.iter_mut().zip(frame) {
            *square_sum += channel_sample * channel_sample;
        }
    }
    frame_count
}

/// The range 0 to `n` in pieces of at most `limit`.
fn chunks(n: usize, limit: usize) -> impl Iterator<Item = Range<usize>> {
    let limit = limit.max(1);
    (0..n)
        .step_by(limit)
        .map(move |chunk_start| chunk_start..n.min(chunk_start + limit))
}
