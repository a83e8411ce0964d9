//! From characters to tokens.

use super::error::{LawError, LawField};

/// What a token is.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    Number(f64),
    Name(String),
    Sign(&'static str),
    End,
}

/// A token and its place, in characters.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Token {
    pub(super) kind: Kind,
    pub(super) offset: usize,
    pub(super) length: usize,
}

impl Token {
    /// The row of a table whose key is this sign; `None` for other tokens.
    pub(super) fn row_of_sign<'t, T>(&self, table: &'t [T], key: impl Fn(&T) -> &str) -> Option<&'t T> {
        match self.kind {
            Kind::Sign(sign) => table.iter().find(|row| key(row) == sign),
            _ => None,
        }
    }
}

/// Longer signs first, so that `**` is not read as two.
const SIGNS: [&str; 14] = [
    "**", "<=", ">=", "==", "!=", "<", ">", "+", "-", "*", "/", "(", ")", ",",
];

/// Signs of other languages: the sign, why it has no meaning here, and what to write instead.
const FOREIGN_SIGNS: [(&str, &str, Option<&str>); 10] = [
    ("//", "There is no integer division.", Some("/")),
    ("^", "A power is written with two stars.", Some("**")),
    ("=", "One `=` does not compare; two do.", Some("==")),
    ("!", "A single `!` has no meaning; unequal is `!=`.", Some("!=")),
    ("[", "Only parentheses group.", Some("(")),
    ("]", "Only parentheses group.", Some(")")),
    ("{", "Only parentheses group.", Some("(")),
    ("}", "Only parentheses group.", Some(")")),
    (".", "A point is allowed only inside a number.", None),
    ("−", "This minus is a typographic one.", Some("-")),
];

/// Split a text; the last token is the end.
pub(super) fn tokens(field: LawField, text: &str) -> Result<Vec<Token>, LawError> {
    let characters: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let mut position = 0;
    while let Some(&first_character) = characters.get(position) {
        if first_character.is_whitespace() {
            position += 1;
            continue;
        }
        let characters_left = &characters[position..];
        let (kind, length) =
            if first_character.is_ascii_digit() || (first_character == '.' && digit_count(&characters_left[1..]) > 0) {
                read_number(field, characters_left, position)?
            } else if is_letter(first_character) {
                let length = characters_left
                    .iter()
                    .take_while(|c| is_letter(**c) || c.is_numeric())
                    .count();
                (Kind::Name(characters_left[..length].iter().collect()), length)
            } else {
                read_sign(field, characters_left, position)?
            };
        tokens.push(Token {
            kind,
            offset: position,
            length,
        });
        position += length;
    }
    // An error at the end of a text marks its last character, or the first place if the text is empty.
    let text_end = text.trim_end().chars().count();
    tokens.push(Token {
        kind: Kind::End,
        offset: text_end.saturating_sub(1),
        length: 1.min(text_end),
    });
    Ok(tokens)
}

fn is_letter(c: char) -> bool {
    c.is_alphabetic() || c == '_'
}

fn digit_count(characters: &[char]) -> usize {
    characters.iter().take_while(|c| c.is_ascii_digit()).count()
}

/// `1`, `1.5`, `.5`, `1.`, each with an optional exponent.
fn read_number(field: LawField, characters_left: &[char], position: usize) -> Result<(Kind, usize), LawError> {
    let mut length = digit_count(characters_left);
    if characters_left.get(length) == Some(&'.') {
        length += 1 + digit_count(&characters_left[length + 1..]);
    }
    if matches!(characters_left.get(length), Some('e' | 'E')) {
        let sign_length = usize::from(matches!(characters_left.get(length + 1), Some('+' | '-')));
        let exponent_digits = digit_count(characters_left.get(length + 1 + sign_length..).unwrap_or(&[]));
        if exponent_digits > 0 {
            length += 1 + sign_length + exponent_digits;
        }
    }
    let tail_length = characters_left[length..]
        .iter()
        .take_while(|c| is_letter(**c) || c.is_numeric())
        .count();
    if tail_length > 0 {
        let message = "A number in a law has no unit: define a constant with one \
                       (`k: 400N/m`), and write a product with `*`.";
        return Err(LawError::new(field, position, length + tail_length, message.into()));
    }
    let number_text: String = characters_left[..length].iter().collect();
    match number_text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok((Kind::Number(value), length)),
        _ => Err(LawError::new(
            field,
            position,
            length,
            "This number is too large.".into(),
        )),
    }
}

fn read_sign(field: LawField, characters_left: &[char], position: usize) -> Result<(Kind, usize), LawError> {
    let is_at_start =
        |sign: &str| sign.chars().zip(characters_left).filter(|(a, b)| a == *b).count() == sign.chars().count();
    let starts_with_two_character_sign = SIGNS.iter().any(|sign| sign.len() == 2 && is_at_start(sign));
    if let Some((foreign, explanation, replacement)) = FOREIGN_SIGNS
        .iter()
        .find(|row| is_at_start(row.0) && !starts_with_two_character_sign)
    {
        let sign_length = foreign.chars().count();
        return Err(LawError::new(field, position, sign_length, (*explanation).into())
            .with_suggestion(replacement.map(str::to_owned)));
    }
    if let Some(sign) = SIGNS.iter().find(|sign| is_at_start(sign)) {
        return Ok((Kind::Sign(sign), sign.len()));
    }
    let message = match characters_left[0] {
        '"' | '\'' => "A law cannot contain quoted text; write numbers and names.".into(),
        other => format!("`{}` has no meaning in a law.", other.escape_debug()),
    };
    Err(LawError::new(field, position, 1, message))
}
