use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use proptest::prelude::*;

use super::reader::decode;
use super::*;

/// A folder for one test, removed when it ends.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static SERIAL: AtomicU64 = AtomicU64::new(0);
        let folder_serial = SERIAL.fetch_add(1, Ordering::Relaxed);
        let folder_name = format!("ergon-recording-{}-{folder_serial}", std::process::id());
        let folder = std::env::temp_dir().join(folder_name);
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

fn header(n_axes: usize) -> Header {
    let numbered_axis = |i| RecordedAxis {
        player: format!("rémi{i}"),
        key: format!("k{i}"),
    };
    Header {
        rate: 44_100.0,
        frames: 44,
        axes: (0..n_axes).map(numbered_axis).collect(),
        about: r#"{"day":"2026-11-20"}"#.to_owned(),
    }
}

/// A sample whose numbers differ in every field, tick and axis.
fn sample(tick: u64, axis: usize) -> RecordedSample {
    let x = tick as f64 + 0.1 * axis as f64;
    RecordedSample {
        position: x * 1e-3 / 3.0,
        force: -x / 7.0,
        sent_force: x as f32 / 9.0,
        flags: tick as u8,
        clock: (tick as u32).wrapping_mul(1_000) + axis as u32,
    }
}

fn samples(tick: u64, n_axes: usize) -> Vec<RecordedSample> {
    (0..n_axes).map(|axis| sample(tick, axis)).collect()
}

fn recording_of(ticks: &[u64], n_axes: usize) -> Recording {
    let all_samples = ticks.iter().flat_map(|&tick| samples(tick, n_axes));
    Recording::new(header(n_axes), ticks.to_vec(), all_samples.collect()).unwrap()
}

fn written(recording: &Recording) -> Vec<u8> {
    let mut file_bytes = Vec::new();
    recording.write(&mut file_bytes).unwrap();
    file_bytes
}

fn reread(bytes: &[u8]) -> Result<Recording, RecordingError> {
    decode(&mut &bytes[..], bytes.len() as u64, None)
}

#[test]
fn recording_is_read_back_to_the_bit() {
    let temp_folder = Folder::new();
    let take_path = temp_folder.file("a.take");
    let (mut row_sink, recorder_handle) = Recorder::start(&take_path, &header(3)).unwrap();
    let row_ticks: Vec<u64> = (7..20_007).filter(|tick| tick % 1_000 != 3).collect();
    for &tick in &row_ticks {
        while !row_sink.push_row(tick, &samples(tick, 3)) {
            std::thread::yield_now(); // faster than any hand
        }
        if tick % 5_000 == 0 {
            assert!(row_sink.push_event(tick, format_args!(r#"{{"gain":{}}}"#, tick as f64 / 7.0)));
        }
    }
    let recorder_status = recorder_handle.stop().unwrap();
    assert_eq!(recorder_status.rows, row_ticks.len() as u64);
    assert_eq!(recorder_status.write_error, None);
    let recording_read = read(&take_path, None).unwrap();
    let mut expected = recording_of(&row_ticks, 3);
    let gain_event = |tick: u64| (tick, format!(r#"{{"gain":{}}}"#, tick as f64 / 7.0));
    expected.events = [5_000, 10_000, 15_000, 20_000].map(gain_event).to_vec();
    expected.dropped = recorder_status.dropped;
    assert!(recording_read == expected);
    assert!(recording_read.is_complete());
}

#[test]
fn recording_overwrites_no_file() {
    let temp_folder = Folder::new();
    let take_path = temp_folder.file("a.take");
    fs::write(&take_path, "mine").unwrap();
    let refused = Recorder::start(&take_path, &header(1)).map(|_| ());
    assert!(matches!(refused, Err(RecordingError::Io(error)) if error.kind() == std::io::ErrorKind::AlreadyExists));
    assert_eq!(fs::read(&take_path).unwrap(), b"mine");
}

#[test]
fn recording_ends_with_a_dropped_sink() {
    let temp_folder = Folder::new();
    let take_path = temp_folder.file("a.take");
    let (mut row_sink, recorder_handle) = Recorder::start(&take_path, &header(1)).unwrap();
    assert!(row_sink.push_row(5, &samples(5, 1)));
    drop(row_sink);
    drop(recorder_handle);
    let recording_read = read(&take_path, None).unwrap();
    assert!(recording_read.is_finished);
    assert_eq!(recording_read.ticks, [5]);
}

#[test]
fn decode_of_a_part_by_ticks() {
    let mut recording = recording_of(&[3, 4, 6, 9, 10], 2);
    recording.events = vec![(3, "1".into()), (6, "2".into()), (10, "3".into())];
    let file_bytes = written(&recording);
    let decoded_part = |ticks| decode(&mut &file_bytes[..], file_bytes.len() as u64, Some(ticks)).unwrap();
    let mut expected = recording_of(&[4, 6, 9], 2);
    expected.events = vec![(6, "2".into())];
    assert_eq!(decoded_part(1..7), expected, "counted from the first row");
    assert_eq!(decoded_part(0..8), recording);
    assert_eq!(decoded_part(3..3), recording_of(&[], 2));
}

#[test]
fn positions_filled_repeats_before_missing_ticks() {
    let filled_positions = recording_of(&[3, 4, 7], 2).positions_filled().unwrap();
    let position = |tick, axis| sample(tick, axis).position;
    let expected = [3, 4, 4, 4, 7].map(|tick| [position(tick, 0), position(tick, 1)]);
    assert_eq!(filled_positions, expected.concat());
    assert!(recording_of(&[], 2).positions_filled().unwrap().is_empty());
    let distant_rows = recording_of(&[3, u64::MAX - 1], 1).positions_filled();
    assert!(matches!(distant_rows, Err(RecordingError::TooLong)));
}

#[test]
fn reader_skips_unknown_chunks_and_refuses_other_versions() {
    let mut file_bytes = written(&recording_of(&[1], 1));
    let end_offset = file_bytes.len() - chunk::CHUNK_OVERHEAD - 8;
    let end_chunk = file_bytes.split_off(end_offset);
    chunk::append(&mut file_bytes, 77, b"something new");
    file_bytes.extend(end_chunk);
    assert_eq!(reread(&file_bytes).unwrap(), recording_of(&[1], 1));
    file_bytes[8] = 2;
    assert!(matches!(reread(&file_bytes), Err(RecordingError::Version(2))));
}

#[test]
fn reader_drops_rows_going_back() {
    let mut file_bytes = written(&recording_of(&[5, 6], 1));
    file_bytes.truncate(file_bytes.len() - chunk::CHUNK_OVERHEAD - 8);
    let mut row_bytes = vec![0; row::row_bytes(1)];
    for (tick, saved) in [(5, false), (7, true), (4, false)] {
        row::encode(&mut row_bytes, tick, &samples(tick, 1));
        chunk::append(&mut file_bytes, chunk::ROWS, &row_bytes);
        let recording_read = reread(&file_bytes).unwrap();
        assert_eq!(recording_read.ticks.last() == Some(&tick), saved);
    }
    let recording_read = reread(&file_bytes).unwrap();
    assert_eq!(recording_read.ticks, [5, 6, 7]);
    assert_eq!(
        recording_read.lost_bytes,
        2 * (chunk::CHUNK_OVERHEAD + row_bytes.len()) as u64
    );
    assert!(!recording_read.is_finished);
}

#[test]
fn header_check_refuses_impossible_values() {
    let change = |change: fn(&mut Header)| {
        let mut header = header(1);
        change(&mut header);
        header.check().unwrap_err().to_string()
    };
    assert!(change(|h| h.rate = f64::NAN).contains("rate"));
    assert!(change(|h| h.rate = 0.0).contains("rate"));
    assert!(change(|h| h.frames = 0).contains("tick"));
    assert!(change(|h| h.axes.clear()).contains("axes"));
    assert!(change(|h| h.axes = vec![RecordedAxis::default(); 65]).contains("axes"));
    assert!(change(|h| h.axes[0].key = "k".repeat(201)).contains("name"));
    assert!(change(|h| h.about = " ".repeat(1 << 20)).contains("description"));
}

#[test]
fn header_names_are_unique_per_axis() {
    let axis_names = |axes: &[(&str, &str)]| {
        let named_axis = |(player, key): &(&str, &str)| RecordedAxis {
            player: (*player).to_owned(),
            key: (*key).to_owned(),
        };
        let axes = axes.iter().map(named_axis).collect();
        Header { axes, ..header(1) }.names()
    };
    assert_eq!(axis_names(&[("remi", "k2"), ("ada", "k1")]), ["remi", "ada"]);
    assert_eq!(axis_names(&[("remi", "k1"), ("remi", "k2")]), ["remi.k1", "remi.k2"]);
    assert_eq!(axis_names(&[("", "k1"), ("ada", "")]), ["k1", "ada"]);
    assert_eq!(axis_names(&[("", ""), ("ada", "k1")]), ["1", "2"]);
    assert_eq!(axis_names(&[("a", "b"), ("a", "b")]), ["1", "2"]);
    assert_eq!(axis_names(&[("k1", ""), ("", "k1")]), ["1", "2"]);
}

#[test]
fn read_refuses_folders_and_other_files() {
    let temp_folder = Folder::new();
    let refused = read(&temp_folder.0, None);
    assert!(matches!(refused, Err(RecordingError::Io(_))));
    let mut other_file = fs::File::create(temp_folder.file("no.take")).unwrap();
    other_file.write_all(b"t [s],x [mm]\n0,0\n1,0\n").unwrap();
    let refused = read(&temp_folder.file("no.take"), None);
    assert!(matches!(refused, Err(RecordingError::NotARecording)));
}

/// Recordings of some axes, with gaps, divided into chunks.
fn recordings() -> impl Strategy<Value = (Vec<Vec<u64>>, usize)> {
    let chunk_steps = prop::collection::vec(prop::collection::vec(1_u64..4, 1..20), 1..6);
    (chunk_steps, 1_usize..4).prop_map(|(chunk_steps, n_axes)| {
        let mut current_tick = 0;
        let mut next_tick = |step: u64| {
            current_tick += step;
            current_tick
        };
        let tick_chunks = chunk_steps
            .into_iter()
            .map(|chunk| chunk.into_iter().map(&mut next_tick).collect());
        (tick_chunks.collect(), n_axes)
    })
}

/// The bytes of the file, and the offsets at which chunks of rows end.
fn laid_out(chunks: &[Vec<u64>], n_axes: usize) -> (Vec<u8>, Vec<usize>) {
    let mut file_bytes = reader::encode_start(&header(n_axes));
    let mut chunk_ends = Vec::new();
    for ticks in chunks {
        let mut payload = vec![0; ticks.len() * row::row_bytes(n_axes)];
        for (row, &tick) in payload.chunks_exact_mut(row::row_bytes(n_axes)).zip(ticks) {
            row::encode(row, tick, &samples(tick, n_axes));
        }
        chunk::append(&mut file_bytes, chunk::ROWS, &payload);
        chunk_ends.push(file_bytes.len());
    }
    (file_bytes, chunk_ends)
}

proptest! {
    #[test]
    fn cut_file_loses_its_last_chunk_only(
        (chunks, n_axes) in recordings(),
        part in 0.0..1.0_f64,
    ) {
        let (mut bytes, ends) = laid_out(&chunks, n_axes);
        let start = reader::encode_start(&header(n_axes)).len();
        let cut = start + ((bytes.len() - start) as f64 * part) as usize;
        bytes.truncate(cut);
        let found = reread(&bytes).unwrap();
        let n_whole = ends.iter().filter(|&&end| end <= cut).count();
        let whole = ends[..n_whole].last().copied().unwrap_or(start);
        let mut wanted = recording_of(&chunks[..n_whole].concat(), n_axes);
        wanted.is_finished = false;
        wanted.lost_bytes = (cut - whole) as u64;
        prop_assert_eq!(found, wanted);
    }

    #[test]
    fn damaged_payload_loses_its_chunk_only(
        (chunks, n_axes) in recordings(),
        which in 0.0..1.0_f64,
        at in 0.0..1.0_f64,
        bits in 1_u8..,
    ) {
        let (mut bytes, ends) = laid_out(&chunks, n_axes);
        let start = reader::encode_start(&header(n_axes)).len();
        let which = (chunks.len() as f64 * which) as usize;
        let begin = if which == 0 { start } else { ends[which - 1] };
        let payload = ends[which] - begin - chunk::CHUNK_OVERHEAD;
        // Damage after the length: in kind, checksum or payload.
        let at = begin + 4 + ((payload + 5) as f64 * at) as usize;
        bytes[at] ^= bits;
        let found = reread(&bytes).unwrap();
        let mut left = chunks.clone();
        left.remove(which);
        prop_assert_eq!(found.ticks, left.concat());
        prop_assert_eq!(found.lost_bytes, (ends[which] - begin) as u64);
    }

    #[test]
    fn damaged_recordings_are_read_or_refused(
        (chunks, n_axes) in recordings(),
        changes in prop::collection::vec((0.0..1.0_f64, any::<u8>(), 0_usize..40), 1..6),
    ) {
        let (mut bytes, _) = laid_out(&chunks, n_axes);
        for (at, byte, n) in changes {
            let at = (bytes.len() as f64 * at) as usize;
            let end = bytes.len().min(at + n);
            match byte % 3 {
                0 => bytes[at..end].fill(byte),
                1 => drop(bytes.drain(at..end)),
                _ => drop(bytes.splice(at..at, vec![byte; n])),
            }
        }
        // Rows that are read equal the rows that were recorded.
        if let Ok(found) = reread(&bytes) {
            let n_axes = found.header.axes.len();
            let played = chunks.concat();
            for (tick, row) in found.ticks.iter().zip(found.samples.chunks_exact(n_axes)) {
                prop_assert!(played.contains(tick));
                prop_assert_eq!(row, samples(*tick, n_axes));
            }
        }
    }

    #[test]
    fn random_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut all = reader::encode_start(&header(1));
        all.extend(&bytes);
        if let Ok(found) = reread(&all) {
            prop_assert_eq!(found.ticks.len(), found.samples.len());
        }
        prop_assert!(reread(&bytes).is_err());
    }
}
