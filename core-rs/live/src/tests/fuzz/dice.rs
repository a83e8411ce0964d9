//! Random numbers, and damaged copies of bytes and text.

/// Splitmix64: the same numbers on every machine.
pub(super) struct Dice(u64);

impl Dice {
    pub(super) fn seeded(case: u64) -> Self {
        Self(case.wrapping_mul(0xD134_2543_DE82_EF95))
    }

    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ (x >> 31)
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub(super) fn pick<'a, T: ?Sized>(&mut self, all: &[&'a T]) -> &'a T {
        all[self.below(all.len())]
    }

    pub(super) fn byte(&mut self) -> u8 {
        self.next() as u8
    }
}

/// A copy with one to four kinds of damage: bits flipped, bytes set, cut, removed or doubled, numbers at their limits.
pub(super) fn damaged(dice: &mut Dice, complete: &[u8]) -> Vec<u8> {
    const EDGES: [&[u8]; 6] = [
        &[0; 8],
        &[0xFF; 8],
        &[0, 0, 0, 0x80],
        &[0xFF, 0xFF, 0xFF, 0x7F],
        &[0, 0, 0, 0, 0, 0, 0xF0, 0x7F],
        &[1, 0, 0, 0],
    ];
    let mut bytes = complete.to_vec();
    for _ in 0..1 + dice.below(4) {
        if bytes.is_empty() {
            bytes.push(dice.byte());
        }
        let position = dice.below(bytes.len());
        let end = bytes.len().min(position + 1 + dice.below(24));
        match dice.below(8) {
            0 | 1 => bytes[position] ^= 1 << dice.below(8),
            2 => bytes[position] = dice.byte(),
            3 => bytes.truncate(position),
            4 => drop(bytes.drain(position..end)),
            5 => {
                let part = bytes[position..end].to_vec();
                drop(bytes.splice(position..position, part));
            }
            6 => {
                for (to, from) in bytes[position..].iter_mut().zip(dice.pick(&EDGES)) {
                    *to = *from;
                }
            }
            _ => {
                let part: Vec<u8> = (0..dice.below(9)).map(|_| dice.byte()).collect();
                drop(bytes.splice(position..position, part));
            }
        }
    }
    bytes
}

/// Words in random order, or a line with damaged bytes.
pub(super) fn text(dice: &mut Dice, lines: &[&str], words: &[&str]) -> String {
    if dice.below(2) == 0 {
        let line = dice.pick(lines);
        return String::from_utf8_lossy(&damaged(dice, line.as_bytes())).into_owned();
    }
    (0..dice.below(24)).map(|_| dice.pick(words)).collect()
}
