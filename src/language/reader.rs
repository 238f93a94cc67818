//! The characters of a command line. A board ignores case and blanks, except that a blank ends a word (Software
//! Reference p. 17).

/// A place in a line.
#[derive(Debug, Clone)]
pub(super) struct Reader<'a> {
    pub(super) line: &'a [u8],
    pub(super) at: usize,
}

impl Reader<'_> {
    /// The byte here, in capitals.
    pub(super) fn byte(&self) -> Option<u8> {
        self.line.get(self.at).map(u8::to_ascii_uppercase)
    }

    /// Skips blanks, and returns the next byte in capitals without taking it.
    pub(super) fn peek(&mut self) -> Option<u8> {
        self.skip_while(|byte| byte == b' ');
        self.byte()
    }

    /// Whether the next byte behind blanks is one of `bytes`.
    pub(super) fn is_next(&self, bytes: &[u8]) -> bool {
        self.clone().peek().is_some_and(|byte| bytes.contains(&byte))
    }

    /// Skips the bytes from here on that are `wanted`, and returns how many.
    pub(super) fn skip_while(&mut self, wanted: impl Fn(u8) -> bool) -> usize {
        let start = self.at;
        while self.byte().is_some_and(&wanted) {
            self.at += 1;
        }
        self.at - start
    }

    /// Takes `text`, with blanks before it, if it comes next.
    pub(super) fn takes(&mut self, text: &str) -> bool {
        let start = self.at;
        self.peek();
        let end = self.at + text.len();
        let comes =
            self.line.get(self.at..end).is_some_and(|next| next.eq_ignore_ascii_case(text.as_bytes()));
        self.at = if comes { end } else { start };
        comes
    }

    /// Takes the longest of the words that come next, with blanks before it, and returns the word and the value beside
    /// it.
    pub(super) fn word<T: Copy>(&mut self, words: &[(T, &'static str)]) -> Option<(T, &'static str)> {
        let all = words.iter().flat_map(|(what, words)| words.split('|').map(move |word| (*what, word)));
        let fits = all.filter(|(_, word)| self.clone().takes(word));
        let longest = fits.max_by_key(|(_, word)| word.len())?;
        self.takes(longest.1);
        Some(longest)
    }

    /// Takes a whole number, with blanks before it and in it.
    pub(super) fn number(&mut self) -> Option<u32> {
        let (mut number, mut end) = (None, self.at);
        while let Some(digit @ b'0'..=b'9') = self.peek() {
            self.at += 1;
            end = self.at;
            number = Some(number.unwrap_or(0_u32).saturating_mul(10).saturating_add(u32::from(digit - b'0')));
        }
        self.at = end;
        number
    }

    /// Takes a hexadecimal number from here on. Behind a blank, A to F are commands.
    pub(super) fn hexadecimal(&mut self) -> Option<u32> {
        let mut number = None;
        while let Some(digit) = self.byte().and_then(|byte| char::from(byte).to_digit(16)) {
            self.at += 1;
            number = Some(number.unwrap_or(0_u32).saturating_mul(16).saturating_add(digit));
        }
        number
    }

    /// Whether `$` and a hexadecimal digit stand here.
    pub(super) fn is_hexadecimal(&self) -> bool {
        self.byte() == Some(b'$') && self.line.get(self.at + 1).is_some_and(u8::is_ascii_hexdigit)
    }

    /// Skips the parenthesis that begins here; returns `false`, and stays, if it does not end.
    pub(super) fn parenthesis_here(&mut self) -> bool {
        let mut depth = 0_usize;
        for (at, byte) in self.line.iter().enumerate().skip(self.at) {
            match byte {
                b'(' => depth += 1,
                b')' => depth = depth.saturating_sub(1),
                _ => {}
            }
            if depth == 0 {
                self.at = at + 1;
                return true;
            }
        }
        false
    }
}
