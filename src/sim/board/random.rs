//! A small seeded generator (xorshift64*), so that a run with noise can be repeated.

/// The generator.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// A generator; equal seeds give equal sequences.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        // The state must not be zero.
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// The next word, each as likely.
    pub fn word(&mut self) -> u16 {
        ((self.unit() + 1.0) * 32_768.0) as u16
    }

    /// The next number, evenly spread over [-1, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        bits as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sequence_repeats_and_stays_in_range() {
        let (mut a, mut b) = (Random::new(7), Random::new(7));
        let numbers: Vec<f64> = (0..1000).map(|_| a.unit()).collect();
        assert!(numbers.iter().all(|&n| (-1.0..1.0).contains(&n) && n == b.unit()));
        assert!(numbers.iter().sum::<f64>().abs() < 100.0);
        assert_ne!(Random::new(8).unit(), numbers[0]);
    }
}
