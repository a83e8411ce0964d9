//! Why a law is refused, and where in its text.

use std::fmt;

/// The part of a law that is at fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LawField {
    /// The elastic expression.
    Law,
    /// The damping expression.
    Damping,
    /// The table of points; `offset` is then the index of a point.
    Points,
    /// A named constant.
    Constants,
    /// The factor of a lever.
    Reach,
}

impl LawField {
    /// The name of the field as a composer writes it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Law => "law",
            Self::Damping => "damping",
            Self::Points => "points",
            Self::Constants => "constants",
            Self::Reach => "reach",
        }
    }
}

impl fmt::Display for LawField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A law that cannot be compiled.
///
/// `offset` and `length` count characters (not bytes) of the text that `field` names.
///
/// ```
/// use ergon_engine::law::{Law, LawText};
///
/// let text = LawText { law: Some("2*d + tahn(d)"), ..LawText::default() };
/// let error = Law::new(&text).unwrap_err();
/// assert_eq!((error.offset, error.length), (6, 4));
/// assert_eq!(error.suggestion.as_deref(), Some("tanh"));
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {message}")]
pub struct LawError {
    /// The text at fault.
    pub field: LawField,
    /// First character at fault.
    pub offset: usize,
    /// How many characters are at fault.
    pub length: usize,
    /// A sentence.
    pub message: String,
    /// A correction of the text at fault.
    pub suggestion: Option<String>,
}

impl LawError {
    pub(super) fn new(field: LawField, offset: usize, length: usize, message: String) -> Self {
        Self {
            field,
            offset,
            length,
            message,
            suggestion: None,
        }
    }

    pub(super) fn with_suggestion(mut self, suggestion: impl Into<Option<String>>) -> Self {
        self.suggestion = suggestion.into();
        self
    }
}

/// The candidate nearest to `word`: at most one slip away for words of up to four letters, two for longer ones.
pub(super) fn nearest_word<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    let letters: Vec<char> = word.chars().flat_map(char::to_lowercase).collect();
    // The table of slips grows with the length, and a word this long is not a typing error.
    if letters.len() > 32 {
        return None;
    }
    let slips_max = if letters.len() <= 4 { 1 } else { 2 };
    candidates
        .map(|candidate| {
            let candidate_letters: Vec<char> = candidate.chars().flat_map(char::to_lowercase).collect();
            (slips(&letters, &candidate_letters), candidate)
        })
        // A single letter is one slip away from any other, so only its case is corrected.
        .filter(|(n, _)| *n <= slips_max && (*n < letters.len()))
        .min_by_key(|(n, _)| *n)
        .map(|(_, candidate)| candidate.to_owned())
}

/// Number of insertions, deletions, changes and swaps of neighbours from `a` to `b` (optimal string alignment).
fn slips(a: &[char], b: &[char]) -> usize {
    let mut earlier_row = vec![0; b.len() + 1];
    let mut previous_row: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut current_row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let change_cost = previous_row[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            current_row[j] = change_cost.min(previous_row[j] + 1).min(current_row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                current_row[j] = current_row[j].min(earlier_row[j - 2] + 1);
            }
        }
        earlier_row = std::mem::replace(&mut previous_row, current_row);
    }
    previous_row[b.len()]
}
