//! What a certificate says, and what is refused.
