//! The keys that pages may play: what they take from a page, and what a page sees of them.

use std::fmt;
use std::sync::Arc;

/// Longest list of positions in a message.
pub(super) const POSITIONS_MAX: usize = 64;
/// Bytes of a position: when [s of the server], where [m], pressure from 0 to 1.
const POSITION_BYTES: usize = 16;
/// Bytes before the positions: number of the key, what happens, number of positions.
const HEAD_BYTES: usize = 4;
/// Longest message from a page [bytes].
pub(super) const MESSAGE_MAX: usize = HEAD_BYTES + POSITIONS_MAX * POSITION_BYTES;

/// A key that a page may play. Its methods are called from any thread, and wait for nobody for long.
pub trait PageKey: Send + Sync + fmt::Debug {
    /// Its name on the page.
    fn name(&self) -> &str;
    /// By what the page plays it at first: `page` (a pointer) or `keys` (letters of the keyboard).
    fn input(&self) -> &str;
    /// The two ends of its travel [m].
    fn range(&self) -> [f64; 2];
    /// A page takes the key; false if another page holds it.
    fn acquire(&self) -> bool;
    /// Whether a page holds it.
    fn is_held(&self) -> bool;
    /// The page that holds the key leaves it.
    fn release(&self);
    /// The pointer was at `x` [m] `age` [s] ago, with a pressure from 0 to 1, or was lifted; false if that is refused.
    fn add_position(&self, age: f64, x: f64, pressure: Option<f64>) -> bool;
    /// Count a position of a page that does not hold the key.
    fn count_refused(&self);
    /// What is drawn.
    fn points(&self) -> KeyPoints;
}

/// Pointer, finger and key [m], and the force of the pointer on the finger [N]. Pointer and finger are not numbers
/// while no finger is on the key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyPoints {
    /// The pointer, as it pulls the finger.
    pub pointer: f64,
    /// The finger.
    pub finger: f64,
    /// The key.
    pub key: f64,
    /// The force of the spring and damper between pointer and finger.
    pub force: f64,
}

/// Positions of a pointer on a key, or its lift.
#[derive(Debug, PartialEq)]
pub(super) struct KeyInput {
    /// Number of the key.
    pub(super) key: usize,
    /// (when [s of the server], where [m], pressure; none: lifted).
    pub(super) positions: Vec<(f64, f64, Option<f64>)>,
}

/// Parses the positions in a message; `None` if it is not such a message.
pub(super) fn parse_input(bytes: &[u8]) -> Option<KeyInput> {
    let (head_bytes, row_bytes) = bytes.split_at_checked(HEAD_BYTES)?;
    let is_lift = match head_bytes[1] {
        0 => false,
        1 => true,
        _ => return None,
    };
    let position_count = usize::from(u16::from_le_bytes([head_bytes[2], head_bytes[3]]));
    if position_count == 0 || position_count > POSITIONS_MAX || row_bytes.len() != position_count * POSITION_BYTES {
        return None;
    }
    let positions = row_bytes.chunks_exact(POSITION_BYTES).map(|row| {
        let number_at = |offset: usize| {
            let word_bytes = row[offset..offset + 4].try_into().expect("four bytes");
            f64::from(f32::from_le_bytes(word_bytes))
        };
        let position_time = f64::from_le_bytes(row[..8].try_into().expect("eight bytes"));
        (position_time, number_at(8), (!is_lift).then(|| number_at(12)))
    });
    Some(KeyInput {
        key: usize::from(head_bytes[0]),
        positions: positions.collect(),
    })
}

/// The keys as JSON, which a page asks for.
pub(super) fn key_list_json(keys: &[Arc<dyn PageKey>]) -> String {
    let key_rows: Vec<_> = keys
        .iter()
        .map(|key| {
            let (key_name, input_kind, [range_low, range_high]) = (escape_json(key.name()), key.input(), key.range());
            format!(
                "{{\"name\": \"{key_name}\", \"input\": \"{input_kind}\", \"low\": {range_low}, \"high\": {range_high}}}"
            )
        })
        .collect();
    format!("[{}]", key_rows.join(", "))
}

/// Text as it stands inside a string of JSON.
fn escape_json(text: &str) -> String {
    text.chars()
        .filter(|c| !c.is_control())
        .flat_map(|c| matches!(c, '"' | '\\').then_some('\\').into_iter().chain([c]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(key: u8, kind: u8, rows: &[(f64, f32, f32)]) -> Vec<u8> {
        let mut message_bytes = vec![key, kind];
        message_bytes.extend((rows.len() as u16).to_le_bytes());
        for &(time, x, pressure) in rows {
            message_bytes.extend(time.to_le_bytes());
            message_bytes.extend(x.to_le_bytes());
            message_bytes.extend(pressure.to_le_bytes());
        }
        message_bytes
    }

    #[test]
    fn message_of_positions_and_lifts() {
        let pointer_rows = [(1.5, 0.25, 0.5), (1.75, -0.5, 1.0)];
        let parsed_moves = parse_input(&message(3, 0, &pointer_rows)).unwrap();
        assert_eq!(parsed_moves.key, 3);
        assert_eq!(parsed_moves.positions[1], (1.75, -0.5, Some(1.0)));
        let parsed_lifts = parse_input(&message(0, 1, &pointer_rows[..1])).unwrap();
        assert_eq!(parsed_lifts.positions, [(1.5, 0.25, None)]);
    }

    #[test]
    fn message_of_random_bytes() {
        let valid_message = message(0, 0, &[(0.0, 0.0, 0.0)]);
        for bytes in [
            &[][..],
            &valid_message[..3],
            &valid_message[..19],
            &message(0, 2, &[(0.0, 0.0, 0.0)]),
            &message(0, 0, &[]),
            &message(0, 0, &[(0.0, 0.0, 0.0); POSITIONS_MAX + 1]),
        ] {
            assert_eq!(parse_input(bytes), None);
        }
    }
}
