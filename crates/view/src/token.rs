use std::fmt;

use subtle::ConstantTimeEq as _;

use crate::ViewError;

/// What a browser must show to be let in: 128 random bits.
#[derive(Clone)]
pub(crate) struct Token(String);

impl Token {
    pub(crate) fn random() -> Result<Self, ViewError> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes).map_err(ViewError::Random)?;
        Ok(Self(format!("{:032x}", u128::from_be_bytes(bytes))))
    }

    /// Whether a token that was shown is this one; how long that takes tells nothing of where they differ.
    pub(crate) fn is(&self, shown: &str) -> bool {
        self.0.as_bytes().ct_eq(shown.as_bytes()).into()
    }
}

/// As it stands in the address that the operator opens.
impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_have_128_bits_differ_and_know_themselves() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        let text = one.to_string();
        assert_eq!(text.len(), 32);
        assert!(one.is(&text) && !other.is(&text) && !one.is(&text[1..]) && !one.is(""));
    }
}
