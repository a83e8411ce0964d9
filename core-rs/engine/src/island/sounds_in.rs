//! Inputs of a sound card in an island: samples in, tick by tick; where none came, those of a file.

use crate::state::{Body, Target};
use crate::timeline::{Drive, DriveKind, SoundIn, Source};

/// Most frames that are handed over at once.
pub(crate) const FRAMES_MAX: usize = 4_096;

/// A MAT that an input moves or pushes.
#[derive(Clone, Debug)]
pub(super) struct SoundDrive {
    pub(super) mat: usize,
    kind: DriveKind,
    sound: SoundIn,
    scale: f64,
    /// Steps in a frame of the score.
    steps: u64,
}

/// Values that were played.
#[derive(Clone, Debug)]
pub(super) struct Played {
    /// Frame of the score of the first; `None`: nobody plays.
    from: Option<u64>,
    /// The value of the frame before.
    before: f64,
    n: usize,
    /// (FRAMES_MAX), of which `n` hold.
    values: Box<[f64]>,
}

impl Played {
    fn at(&self, frame: u64, sound: &SoundIn) -> f64 {
        match self.from {
            Some(from) if frame >= from => {
                let index = usize::try_from(frame - from).unwrap_or(usize::MAX);
                self.values[..self.n].get(index).copied().unwrap_or(0.0)
            }
            Some(from) if frame + 1 == from => self.before,
            _ => sound.at(frame),
        }
    }
}

/// The MATs among drives that inputs drive, and nothing played into them.
pub(super) fn sound_drives(drives: &[Drive]) -> (Vec<SoundDrive>, Vec<Played>) {
    let sound_drive = |drive: &Drive| match &drive.source {
        Source::SoundIn {
            sound,
            scale,
            steps,
        } => Some(SoundDrive {
            mat: drive.mat,
            kind: drive.kind,
            sound: sound.clone(),
            scale: *scale,
            steps: u64::from(*steps),
        }),
        _ => None,
    };
    let all: Vec<SoundDrive> = drives.iter().filter_map(sound_drive).collect();
    let played = || Played {
        from: None,
        before: 0.0,
        n: 0,
        values: vec![0.0; FRAMES_MAX].into(),
    };
    let played = all.iter().map(|_| played()).collect();
    (all, played)
}

/// Add the forces of step `n`, and impose the positions at its end.
///
/// Between frames a force holds, and a position goes evenly.
pub(super) fn apply(
    drives: &[SoundDrive],
    played: &[Played],
    n: u64,
    body: &mut Body,
    targets: &mut Vec<Target>,
) {
    for (drive, played) in drives.iter().zip(played) {
        let frame = n / drive.steps;
        let value = played.at(frame, &drive.sound);
        if drive.kind == DriveKind::Force {
            body.push(drive.mat, drive.scale * value);
            continue;
        }
        let done = n % drive.steps + 1;
        let x = if done == drive.steps {
            value
        } else {
            let before = frame
                .checked_sub(1)
                .map_or(0.0, |frame| played.at(frame, &drive.sound));
            before + (value - before) * (done as f64 / drive.steps as f64)
        };
        targets.push(Target {
            mat: drive.mat,
            x: drive.scale * x,
            previous: 0.0,
        });
    }
}

impl super::Island {
    /// Take the values of an input for the frames of the score from `from` on [m or N]; `before`: that of the frame before.
    pub(crate) fn hear(&mut self, index: usize, from: u64, before: f64, values: &[f64]) {
        let pairs = self.script.sound_drives.iter().zip(&mut self.state.played);
        for (_, played) in pairs.filter(|(drive, _)| drive.sound.index == index) {
            let n = values.len().min(FRAMES_MAX);
            played.values[..n].copy_from_slice(&values[..n]);
            (played.from, played.before, played.n) = (Some(from), before, n);
        }
    }
}
