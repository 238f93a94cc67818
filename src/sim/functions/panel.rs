//! PMAC's half of the control panel (DPRAM manual pp. 12-13).
//!
//! With I2=3, PMAC sees request bits in the request mask in one background pass and acts in the next, to catch a host
//! that goes on writing after its flag. Then PMAC clears the whole mask and leaves the request words as they are. In
//! every pass it copies the overrides whose bit in the override mask is set, times 256, into the coordinate system's
//! command override register. `%` writes that register too, and Ix93 decides whether the register counts.
//!
//! The manual leaves open, and the simulator decides:
//! * A jog goes on until another request or command ends it: a request is a `J+` command, not a held button.
//! * A number whose word is 0 has no request.
//! * Of several requests for a motor, stop wins over jog, jog over pre-jog, pre-jog over home. For a coordinate system,
//!   abort wins over hold, hold over step, step over start. Holds and aborts come after all other requests.
//! * Step quits a program that runs, and steps a program that does not.
//! * PMAC drops in silence a request that it cannot carry out: the panel has no port to report to.

use crate::map::functions::panel_request::{
    FEED_HOLD, HOME, JOG_MINUS, JOG_PLUS, PRE_JOG, START, STEP, STOP,
};
use crate::map::{HostOffset, PanelBlock};
use crate::sim::board::Board;
use crate::sim::board::jog::Jog;
use crate::sim::fault::Delay;
use crate::sim::program::Programs;

/// Bits of a request word that request nothing.
const RESERVED: u16 = 0x00FF;
/// Largest override, 1/32768 ms.
const MOST_OVERRIDE: u16 = 0x7FFF;

/// A request: 0-based number and request word.
type Request = (usize, u16);

/// The host's requests: the mask, and the request word of every number.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Asked {
    mask: u32,
    words: Vec<u16>,
}

impl Asked {
    fn has(&self, n: usize) -> bool {
        self.mask >> n & 1 == 1
    }
}

/// The state of the panel.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    /// The requests at the last pass.
    seen: Option<Asked>,
    delay: Delay,
    /// Requests still to be acted on although the mask is clear.
    rest: Vec<Request>,
}

impl Panel {
    /// One background pass.
    pub fn poll(&mut self, board: &mut Board, programs: &mut Programs) {
        let family = board.family();
        let enabled = family.i.panel.is_some_and(|number| board.variables.i(number.into()) == 3.0);
        let Some(panel) = family.panel.as_ref().filter(|_| enabled) else {
            *self = Self::default();
            return;
        };
        copy_overrides(panel, board);
        act(&std::mem::take(&mut self.rest), board, programs);
        let dpram = &board.memory.dpram;
        let mask = u32::from(dpram.read16(panel.request_enable));
        if mask == 0 {
            self.seen = None;
            return;
        }
        dpram.order_reads();
        let words = (0..panel.numbers).map(|n| dpram.read16(word(panel.request, panel, n))).collect();
        let asked = Asked { mask, words };
        let Some(seen) = self.seen.replace(asked.clone()) else { return };
        judge(panel, &seen, &asked, board);
        let fault = board.faults.panel.clone();
        if fault.stuck || !self.delay.over(fault.late) {
            return;
        }
        let mut requests: Vec<Request> =
            (0..panel.numbers).filter(|&n| asked.has(n)).map(|n| (n, asked.words[n])).collect();
        if fault.torn {
            self.rest = requests.split_off(requests.len() / 2);
        }
        self.seen = None;
        act(&requests, board, programs);
        board.memory.dpram.write16(panel.request_enable, 0);
    }
}

/// The word of the 0-based number `n` in the row of words that begins at `first`.
fn word(first: HostOffset, panel: &PanelBlock, n: usize) -> HostOffset {
    first.plus_words(panel.stride * n)
}

/// Whether a mask has bits that belong to no number.
fn has_strays(mask: u32, panel: &PanelBlock) -> bool {
    u64::from(mask) >> panel.numbers != 0
}

fn judge(panel: &PanelBlock, seen: &Asked, now: &Asked, board: &mut Board) {
    let cycle = board.stats.servo_cycles;
    if seen.mask != now.mask {
        let what = format!(
            "the panel's enable mask went from 0x{:04X} to 0x{:04X} before PMAC had taken the requests",
            seen.mask, now.mask
        );
        board.judge.record(cycle, &what);
    }
    for n in (0..panel.numbers).filter(|&n| seen.has(n) && seen.words[n] != now.words[n]) {
        let what = format!("the panel's request word {} changed after its enable bit was set", n + 1);
        board.judge.record(cycle, &what);
    }
    let reserved =
        has_strays(now.mask, panel) || (0..panel.numbers).any(|n| now.has(n) && now.words[n] & RESERVED != 0);
    let what = reserved.then(|| "a panel request has reserved bits set".to_owned());
    board.judge.state(cycle, "panel", what);
}

fn act(requests: &[Request], board: &mut Board, programs: &mut Programs) {
    for &(n, word) in requests {
        // PMAC drops a request that it cannot carry out.
        let _ = match word & (JOG_PLUS | JOG_MINUS) {
            0 if word & PRE_JOG != 0 => board.jog(n, Jog::PreJog, None),
            0 if word & HOME != 0 => board.home(n),
            0 => Ok(()),
            JOG_PLUS => board.jog(n, Jog::Plus, None),
            JOG_MINUS => board.jog(n, Jog::Minus, None),
            _ => board.jog(n, Jog::Stop, None),
        };
        if word & (STOP | FEED_HOLD) != 0 {
            continue;
        }
        if word & STEP != 0 && board.runs_program(n) {
            programs.quit(board, n);
        } else if word & STEP != 0 {
            let _ = programs.step(board, n);
        } else if word & START != 0 {
            let _ = programs.run(board, n);
        }
    }
    for &(n, word) in requests {
        if word & STOP != 0 {
            programs.abort(board, n);
        } else if word & FEED_HOLD != 0 {
            board.feed_hold(n);
        }
    }
}

fn copy_overrides(panel: &PanelBlock, board: &mut Board) {
    let mask = u32::from(board.memory.dpram.read16(panel.override_enable));
    let mut wrong = has_strays(mask, panel).then(|| format!("the panel's override mask is 0x{mask:04X}"));
    for cs in (0..panel.numbers).filter(|cs| mask >> cs & 1 == 1) {
        let value = board.memory.dpram.read16(word(panel.feed_override, panel, cs));
        if value > MOST_OVERRIDE {
            wrong = Some(format!("the panel's override {} is {value}, more than {MOST_OVERRIDE}", cs + 1));
        }
        let register = board.memory.registers().time_base_commanded.of(cs);
        board.memory.write(register, u32::from(value & MOST_OVERRIDE) << 8);
    }
    board.judge.state(board.stats.servo_cycles, "panel override", wrong);
}

#[cfg(test)]
mod tests {
    use crate::sim::testing::Bench;

    fn bench() -> Bench {
        let mut bench = Bench::started();
        bench.set(2, 3.0);
        bench
    }

    /// Sets request words and the mask; runs until PMAC has cleared it.
    fn request(bench: &mut Bench, requests: &[(u32, u16)]) {
        let mask = requests.iter().fold(0, |mask, &(n, word)| {
            bench.write(4 * n, word);
            mask | 1 << (n - 1)
        });
        bench.write(0x0000, mask);
        bench.run(2);
        assert_eq!(bench.read(0x0000), 0);
    }

    fn speed(bench: &Bench, motor: usize) -> f64 {
        bench.world.board.motors[motor].desired_velocity()
    }

    #[test]
    fn motors_jog_stop_and_go_back_as_requested() {
        let mut bench = bench();
        request(&mut bench, &[(1, 1 << 9), (3, 1 << 8)]);
        bench.run(1500);
        assert!(speed(&bench, 0) > 0.0 && speed(&bench, 1) == 0.0 && speed(&bench, 2) < 0.0);
        assert_eq!(bench.read(0x0004), 1 << 9, "request words are left alone");
        request(&mut bench, &[(1, 3 << 8)]);
        bench.run(1500);
        assert!(speed(&bench, 0) == 0.0, "both jog bits stop");
        assert!(speed(&bench, 2) < 0.0, "a jog goes on without further requests");
        request(&mut bench, &[(3, 3 << 8)]);
        bench.run(1500);
        assert!(bench.world.board.position(0) > 100.0);
        request(&mut bench, &[(1, 1 << 10)]);
        bench.run(20_000);
        assert!(bench.world.board.position(0).abs() < 1.0, "pre-jog position");
        assert!(bench.violations().is_empty(), "{:?}", bench.violations());
    }

    #[test]
    fn homing_hold_and_abort() {
        let mut bench = bench();
        bench.world.execute(b"&2 #1->X");
        request(&mut bench, &[(1, 1 << 14)]);
        assert!(bench.world.board.motors[0].searching());
        request(&mut bench, &[(2, 1 << 15)]);
        bench.run(5000);
        assert_eq!(bench.world.board.memory.read_x(0x08C8), 0, "the time base of C.S. 2 went to zero");
        request(&mut bench, &[(2, 1 << 13)]);
        bench.run(3000);
        assert!(!bench.world.board.motors[0].searching() && speed(&bench, 0) == 0.0);
    }

    #[test]
    fn nothing_happens_unless_i2_is_3() {
        let mut bench = Bench::started();
        bench.set(2, 1.0);
        bench.write(0x0004, 1 << 9);
        bench.write(0x0000, 1);
        bench.write(0x0002, 1);
        bench.write(0x0006, 100);
        bench.run(50);
        assert_eq!((bench.read(0x0000), speed(&bench, 0)), (1, 0.0));
        assert_ne!(bench.world.board.memory.read_x(0x0806), 25600);
        bench.set(2, 3.0);
        bench.run(3);
        assert_eq!(bench.read(0x0000), 0);
        assert_eq!(bench.world.board.memory.read_x(0x0806), 25600);
    }

    #[test]
    fn overrides_are_sticky_and_count_only_where_ix93_points_to_them() {
        let mut bench = bench();
        bench.set(293, 100.0);
        for cs in 1..=2 {
            bench.write(4 * cs + 2, 14_507);
        }
        bench.write(0x0002, 0b11);
        bench.run(10);
        let memory = &bench.world.board.memory;
        assert_eq!((memory.read_x(0x0806), memory.read_x(0x08C6)), (14_507 * 256, 14_507 * 256));
        assert!((bench.world.board.override_percent(0) - 100.0).abs() < 0.01);
        assert_eq!(bench.read(0x0002), 0b11, "PMAC does not clear the override mask");
        bench.world.board.set_override(0, 10.0);
        bench.write(0x0006, 32_767);
        bench.run(4000);
        assert!((bench.world.board.override_percent(0) - 225.875).abs() < 0.01);
        assert_eq!(bench.world.board.memory.read_x(0x0808), 8_388_352, "the time base followed");
        assert!(bench.world.board.memory.read_x(0x08C8) < 1000, "C.S. 2 follows I293's address");
        bench.write(0x0002, 0b10);
        bench.run(1);
        bench.world.board.set_override(0, 50.0);
        bench.run(10);
        assert!((bench.world.board.override_percent(0) - 50.0).abs() < 0.01);
        assert!(bench.violations().is_empty());
    }

    #[test]
    fn a_host_that_goes_on_writing_is_found_out() {
        let mut bench = bench();
        bench.write(0x0004, 1 << 9);
        bench.write(0x0000, 1);
        bench.run(1);
        bench.write(0x0004, 1 << 8);
        bench.write(0x0000, 0b11);
        bench.run(1);
        assert_eq!(bench.violations().len(), 2, "{:?}", bench.violations());
        bench.write(0x0008, 0x0200 | 1);
        bench.write(0x0000, 0b110);
        bench.write(0x0006, 0x8000);
        bench.write(0x0002, 1);
        bench.run(5);
        assert_eq!(bench.violations().len(), 4, "{:?}", bench.violations());
    }

    #[test]
    fn faults_hold_the_mask_delay_it_or_clear_it_too_early() {
        let mut bench = bench();
        bench.world.board.faults.panel.stuck = true;
        bench.write(0x0004, 1 << 9);
        bench.write(0x0008, 1 << 9);
        bench.write(0x0000, 0b11);
        bench.run(100);
        assert_eq!(bench.read(0x0000), 0b11);
        bench.world.board.faults.panel.stuck = false;
        bench.world.board.faults.panel.late = 5;
        bench.run(5);
        assert_eq!(bench.read(0x0000), 0b11);
        bench.world.board.faults.panel.torn = true;
        bench.run(1);
        assert_eq!(bench.read(0x0000), 0);
        assert!(!bench.world.board.motors[1].moving());
        bench.run(1);
        assert!(bench.world.board.motors[0].moving() && bench.world.board.motors[1].moving());
    }
}
