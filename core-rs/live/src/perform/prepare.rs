//! Everything that a performance needs before its thread starts: output, ring, recording, keys.

use std::sync::{Arc, Mutex};

use rtrb::RingBuffer;

use super::control::SharedFlags;
use super::keys::KeyboardSlot;
use super::performance::{Performance, SoundEvents};
use super::player::change::SCHEDULED_MAX;
use super::player::{self, Player};
use super::status::{HANDS_MAX, PerformanceStatus};
use super::{
    FORCE_SCALE_MIN, HandKey, HandLimit, Keyboard, PlayError, PlaybackConfig, PreparedPiece, clock, frozen, sound_input,
};
use crate::audio::{self, AudioError};
use crate::recording::Recorder;

/// Default number of frames that the ring holds ahead of the card, enough for a machine without real-time scheduling.
const DEFAULT_FRAMES_AHEAD: usize = 1_024;
/// Greatest number of events that wait to be read.
const EVENTS_MAX: usize = 4_096;
const COMMANDS_MAX: usize = 256;

impl Performance {
    /// Open the output and the recording, and make the player, but not the thread that runs it.
    pub(super) fn prepare(
        mut piece: PreparedPiece,
        keyboards: Vec<Keyboard>,
        config: PlaybackConfig,
    ) -> Result<(Self, Player), PlayError> {
        let (rate, start_frame) = (piece.simulation.rate(), piece.simulation.frame());
        if piece.is_displayed {
            piece.simulation.start_watching();
        }
        let channels = piece.n_heard_channels();
        if !(1..=audio::CHANNELS_MAX).contains(&channels) {
            let reason = format!("an output has 1 to {}", audio::CHANNELS_MAX);
            return Err(AudioError::Channels { channels, reason }.into());
        }
        if piece.hands.len() > HANDS_MAX {
            return Err(PlayError::Hands(piece.hands.len()));
        }
        let hand_keys: Vec<HandKey> = keyboards
            .iter()
            .flat_map(|keyboard| HandKey::from_keyboard(keyboard, &piece.hands))
            .collect();
        let hand_limit = |key: &HandKey| key.limit(&piece.hands[key.hand].piece_response);
        let hand_limits: Vec<HandLimit> = hand_keys.iter().map(hand_limit).collect();
        if let Some(stiff_limit) = hand_limits.iter().find(|limit| limit.force_scale < FORCE_SCALE_MIN) {
            return Err(PlayError::Stiff {
                hand: stiff_limit.hand,
                stiffness: stiff_limit.stiffness,
                limit: stiff_limit.stable_stiffness,
            });
        }
        let block_frames = config.audio.block.unwrap_or(0) as usize;
        let frames_ahead = config
            .frames_ahead
            .unwrap_or(DEFAULT_FRAMES_AHEAD)
            .max(2 * piece.tick_frames.max(block_frames));
        let (ring_writer, ring_reader) = audio::ring(channels, 4 * frames_ahead);
        ring_writer.set_prefill(frames_ahead);
        let frozen_stems = std::mem::take(&mut piece.frozen_stems);
        let (frozen, reader) = if frozen_stems.is_empty() {
            (None, None)
        } else {
            let (frozen, reader) = frozen::open(frozen_stems, piece.simulation.frame())
                .map_err(|(path, error)| PlayError::Frozen { path, error })?;
            (Some(frozen), Some(reader))
        };
        let output = audio::open(&config.audio, rate as u32, channels, ring_reader)?;
        let output_info = output.info();
        if output_info.is_paced && output_info.block as usize > 2 * frames_ahead {
            let error_text = format!(
                "the output takes {} frames at a time: --ahead must be at least {}",
                output_info.block,
                2 * output_info.block
            );
            return Err(AudioError::Broken(error_text).into());
        }
        let (input_source, input_handle) = sound_input::open(
            &config.input,
            &piece.simulation,
            &output_info,
            piece.tick_frames,
            frames_ahead,
        )?;
        // The recording is opened last: a performance that cannot begin leaves no file.
        let (row_sink, recorder) = match &config.recording {
            Some((path, header)) => {
                let (row_sink, recorder_handle) = Recorder::start(path, header)?;
                (Some(row_sink), Some(recorder_handle))
            }
            None => (None, None),
        };
        let (command_producer, command_consumer) = RingBuffer::new(COMMANDS_MAX);
        let (event_producer, event_consumer) = RingBuffer::new(EVENTS_MAX);
        let (garbage_producer, garbage_consumer) = RingBuffer::new(2 * SCHEDULED_MAX);
        let (status_input, status_output) = triple_buffer::triple_buffer(&PerformanceStatus::default());
        let cancellers = keyboards.iter().map(Keyboard::canceller).collect();
        let flags = Arc::new(SharedFlags::new(cancellers));
        let commands = Arc::new(Mutex::new(command_producer));
        let mut reconnectors = Vec::new();
        let slots: Vec<KeyboardSlot> = keyboards
            .into_iter()
            .enumerate()
            .map(|(index, keyboard)| {
                let (keyboard_slot, reconnector) = keyboard.split(index, commands.clone());
                reconnectors.push(reconnector);
                keyboard_slot
            })
            .collect();
        let connections = player::Connections {
            flags: flags.clone(),
            commands: command_consumer,
            events: event_producer,
            status: status_input,
            ring_writer,
            row_sink,
            frozen,
            sound_input: input_source,
            stream_state: output.stream_state().clone(),
            garbage: garbage_producer,
        };
        let has_key_clock = slots.iter().any(KeyboardSlot::has_clock);
        let tick_clock = clock::TickClock::new(
            piece.tick_frames as f64 / rate,
            frames_ahead.max(2 * output_info.block as usize),
            has_key_clock,
            output_info.is_paced,
        );
        let (tick_frames, mixer_channels) = (piece.tick_frames, piece.mixer.n_channels());
        let is_displayed = piece.is_displayed;
        let frozen_outputs = reader.is_some().then(|| piece.simulation.n_out());
        let player = Player::new(
            piece,
            slots,
            connections,
            tick_clock,
            output_info.is_paced || has_key_clock,
            &hand_limits,
        );
        let performance = Self {
            flags,
            physics_thread: None,
            reconnectors,
            commands,
            status: status_output,
            events: event_consumer,
            output,
            recorder,
            frozen_reader: reader,
            hand_limits,
            hand_keys,
            garbage: garbage_consumer,
            n_tickets: 0,
            tap: None,
            input: input_handle,
            sound_events: SoundEvents::default(),
            tick_frames,
            channels,
            mixed_channels: mixer_channels,
            frozen_outputs,
            rate,
            start_frame,
            is_displayed,
        };
        Ok((performance, player))
    }
}
