//! Which motors' loops are open: what the servo report says, as far as it is newer than the last panel request.
//!
//! A jog closes the loop of a killed motor. A report from before that still calls the loop open, and who believed it would
//! leave a motor moving.

/// Updates after a request was taken until the report is believed. The first may have been under way.
const UPDATES: u64 = 2;

/// What is known of the motors' loops; bit 0 is motor 1.
#[derive(Debug, Default)]
pub struct OpenLoops {
    open: u32,
    updates: u64,
    /// Motors of whose loops nothing is known, until that update.
    doubted: u32,
    until: u64,
}

impl OpenLoops {
    /// The report was updated for the `updates`th time, and calls these loops open.
    pub const fn see(&mut self, open: u32, updates: u64) {
        (self.open, self.updates) = (open, updates);
        if updates >= self.until {
            self.doubted = 0;
        }
    }

    /// A request to the panel may have changed the loops of `motors` by now.
    pub const fn doubt(&mut self, motors: u32) {
        self.doubted |= motors;
        self.until = self.updates + UPDATES;
    }

    /// The motors whose loop is open for sure.
    #[must_use]
    pub const fn known(&self) -> u32 {
        self.open & !self.doubted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_from_before_a_request_is_not_believed() {
        let mut loops = OpenLoops::default();
        loops.see(0b11, 7);
        assert_eq!(loops.known(), 0b11);
        loops.doubt(0b01);
        for update in [7, 8] {
            loops.see(0b11, update);
            assert_eq!(loops.known(), 0b10, "update {update}");
        }
        loops.see(0b11, 9);
        assert_eq!(loops.known(), 0b11, "the motor was killed again");
        loops.see(0, 9);
        assert_eq!(loops.known(), 0, "no data come");
    }
}
