//! Random numbers, and damaged copies of bytes and text.

/// Splitmix64: the same numbers on every machine.
pub(super) struct Dice(u64);

impl Dice {
    pub(super) fn seeded(case: u64) -> Self {
        Self(case.wrapping_mul(0xD134_2543_DE82_EF95))
    }

    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed_bits = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed_bits = (mixed_bits ^ (mixed_bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed_bits ^ (mixed_bits >> 31)
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
    let mut damaged_bytes = complete.to_vec();
    for _ in 0..1 + dice.below(4) {
        if damaged_bytes.is_empty() {
            damaged_bytes.push(dice.byte());
        }
        let position = dice.below(damaged_bytes.len());
        let range_end = damaged_bytes.len().min(position + 1 + dice.below(24));
        match dice.below(8) {
            0 | 1 => damaged_bytes[position] ^= 1 << dice.below(8),
            2 => damaged_bytes[position] = dice.byte(),
            3 => damaged_bytes.truncate(position),
            4 => drop(damaged_bytes.drain(position..range_end)),
            5 => {
                let inserted = damaged_bytes[position..range_end].to_vec();
                drop(damaged_bytes.splice(position..position, inserted));
            }
            6 => {
                for (to, from) in damaged_bytes[position..].iter_mut().zip(dice.pick(&EDGES)) {
                    *to = *from;
                }
            }
            _ => {
                let inserted: Vec<u8> = (0..dice.below(9)).map(|_| dice.byte()).collect();
                drop(damaged_bytes.splice(position..position, inserted));
            }
        }
    }
    damaged_bytes
}

/// Words in random order, or a line with damaged bytes.
pub(super) fn text(dice: &mut Dice, lines: &[&str], words: &[&str]) -> String {
    if dice.below(2) == 0 {
        let chosen_line = dice.pick(lines);
        return String::from_utf8_lossy(&damaged(dice, chosen_line.as_bytes())).into_owned();
    }
    (0..dice.below(24)).map(|_| dice.pick(words)).collect()
}
