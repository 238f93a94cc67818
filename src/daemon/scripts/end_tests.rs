//! The ends of gathers, streams and downloads, cut at every step: whatever ends them, and whenever, they leave the
//! board in the right state.

use std::time::{Duration, Instant};

use nix::unistd::{Gid, Uid};

use super::*;
use crate::daemon::shared::info::Info;
use crate::daemon::shared::open_buffer::Barred;
use crate::daemon::shared::queue::Text;
use crate::map::functions::OPEN_BINARY;
use crate::map::{Family, PMAC, TURBO2};
use crate::protocol::{BoardInfo, BoardSettings, CommandPort, calls};

const OWNER: Peer = Peer { uid: Uid::from_raw(1000), gid: Gid::from_raw(1000), pid: 7 };
const ENDINGS: [Ending; 6] = [
    Ending::OwnerGone,
    Ending::OwnerSilent,
    Ending::Stopping,
    Ending::EndedBy(OWNER),
    Ending::AllStopped(OWNER, 1),
    Ending::Aborted(OWNER),
];
/// The bits of `???` for binary entry, of a PMAC and of a Turbo board.
const BINARY_OPEN: u32 = 1 << 6 | 1 << 20;
/// More steps than any sequence here takes until its owner calls no more.
const STEPS: usize = 40;

/// A board as far as gathers, streams and downloads use it.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Board {
    reports: bool,
    report_runs: bool,
    gathers: bool,
    /// The daemon follows the gather buffer into the segment.
    followed: bool,
    timer: u16,
    period: String,
    open: bool,
    transfer: bool,
    /// The daemon has set up the buffer in the DPRAM, and lines may be on their way into it.
    fed: bool,
    runs: bool,
    left: u64,
    ahead: u64,
    resets: u64,
    /// A program buffer that lines have opened, and a variable that they set.
    program_open: bool,
    p1: String,
}

/// How many lines of a stream the daemon has put into the DPRAM.
const SENT: u64 = 5;

impl Board {
    fn new(reports: bool, report_runs: bool) -> Self {
        Self {
            reports,
            report_runs,
            gathers: false,
            followed: false,
            timer: 0,
            period: "1".to_owned(),
            open: false,
            transfer: false,
            fed: false,
            runs: false,
            left: 0,
            ahead: 3,
            resets: 0,
            program_open: false,
            p1: "0".to_owned(),
        }
    }

    /// A reset: the board gathers nothing, has no buffer open and runs nothing, and I19 has its saved value.
    fn reset(&mut self) {
        *self = Self { reports: self.reports, resets: self.resets + 1, ..Self::new(self.reports, false) };
    }

    /// Coordinate system 2 is like coordinate system 1.
    fn line(&mut self, line: &str) -> Option<String> {
        let running = |runs| if runs { "000001000000" } else { "000000000000" };
        match &*line.replace("&2", "&1") {
            "I48" => return Some(u8::from(self.reports).to_string()),
            "I19" => return Some(self.period.clone()),
            "???" => {
                let (first, second) = (u32::from(self.gathers) << 19, u32::from(self.open) * BINARY_OPEN);
                return Some(format!("{first:06X}{second:06X}"));
            }
            "GATHER" if self.reports && !self.report_runs => self.report_runs = true,
            "GATHER" => self.gathers = true,
            "ENDGATHER" if self.gathers => self.gathers = false,
            "ENDGATHER" => self.report_runs = false,
            "&1PR" => {
                let taken = if self.open && !self.runs { SENT - self.ahead } else { 0 };
                return Some((self.left + taken).to_string());
            }
            "&1??" => return Some(running(self.runs).to_owned()),
            OPEN_BINARY => self.open = true,
            "CLOSE" => (self.open, self.program_open) = (false, false),
            "OPEN PROG 1" => self.program_open = true,
            "P1" => return Some(self.p1.clone()),
            "&1CLEAR" => self.left = 0,
            "&1R" => self.runs = true,
            "&1Q" => self.runs = false,
            "I57=0" => self.transfer = false,
            "I57=1" => self.transfer = true,
            _ => {
                if let Some(period) = line.strip_prefix("I19=") {
                    self.period = period.to_owned();
                } else if let Some(value) = line.strip_prefix("P1=") {
                    self.p1 = value.to_owned();
                }
            }
        }
        None
    }

    /// The daemon does a job.
    fn job(&mut self, job: &Job, done: &mut Done) {
        match job {
            Job::GatherBegin { .. } => self.followed = true,
            Job::GatherEnd => self.followed = false,
            Job::RotaryOpen { .. } => self.fed = true,
            Job::RotaryFinish(_) => self.fed = false,
            Job::RotaryState(_) => {
                done.rotary = Some(RotaryState {
                    ahead_longs: 0,
                    ahead_commands: 0,
                    ahead_lines: self.ahead,
                    is_inside_line: false,
                    sent_lines: SENT,
                    busy: false,
                    error: None,
                    underruns: 0,
                });
            }
            _ => {}
        }
    }

    /// Does a step with this `outcome`: a step counts as done unless the daemon knows that it is undone.
    fn take(&mut self, request: &Request, outcome: Outcome) -> Done {
        let is_done = !outcome.is_unsent();
        let gathers = self.report_runs.then_some(self.gathers);
        let (result, words) = (Ok(Vec::new()), Vec::new());
        let mut done = Done {
            outcome,
            result,
            resets: self.resets,
            doubts: 0,
            rotary: None,
            words,
            gathers,
            programs_run: None,
            ended_by: None,
        };
        match request {
            Request::Line(line) | Request::Ask(line) if is_done => {
                done.result = Ok(self.line(line).into_iter().collect());
            }
            Request::Control(_) => {
                let system = if self.runs { "000001000000" } else { "000000000000" };
                done.result = Ok(vec![[system; 8].join(" ")]);
            }
            Request::Read { count, .. } => {
                self.timer += u16::from(self.report_runs);
                done.words = vec![self.timer; *count];
            }
            Request::Job(job) if is_done => self.job(job, &mut done),
            _ => {}
        }
        match outcome {
            Outcome::Done => {}
            Outcome::TimedOut => done.result = Err(CallError::TimedOut { lines: Vec::new() }),
            _ => done.result = Err(CallError::Busy),
        }
        done
    }
}

/// Drives `machine` until it is over. Before step `cut` the sequence ends, for the reason `why`; step `fails` has this
/// outcome.
fn drive(
    machine: &mut Script,
    board: &mut Board,
    (cut, why): (usize, Ending),
    (fails, outcome): (usize, Outcome),
) -> Result<Reply, CallError> {
    let (mut now, mut done, mut steps) = (Instant::now(), None, 0);
    let mut has_ended = false;
    loop {
        if steps >= cut && !std::mem::replace(&mut has_ended, true) {
            machine.end(why);
        }
        let step = machine.next(done.take(), now);
        match step {
            Step::Over(reply) => return reply,
            Step::Wait(moment) => now = moment,
            Step::Rest => steps = cut,
            Step::Answer(_) | Step::Tell(_) | Step::AnswerEnd(_) => {}
            Step::Board(request, _) => {
                let outcome = if steps == fails { outcome } else { Outcome::Done };
                done = Some(board.take(&request, outcome));
                steps += 1;
            }
        }
        assert!(steps < cut + 4 * STEPS, "it does not end: {machine:?}");
    }
}

fn info_of(family: &'static Family) -> Info {
    Info::new(family, BoardInfo::default(), BoardSettings::default())
}

fn info() -> Info {
    info_of(&PMAC)
}

fn a_gather() -> Script {
    let place = PMAC.gather;
    let call = calls::GatherStart {
        buffer: calls::Offset(place.buffer),
        size_word: calls::Offset(place.size),
        index_word: calls::Offset(place.index),
        registers: vec!["X:$0000".to_owned(), "D:$002B".to_owned()],
        size_longs: 300,
        period: 3,
        wrap: None,
        servo_period_ns: Some(442_708),
    };
    gather(GatherCall::of(call, &info()).unwrap(), OWNER)
}

#[test]
fn a_gather_cut_anywhere_leaves_the_board_as_it_was_and_is_followed_no_more() {
    for (reports, report_runs) in [(true, true), (true, false), (false, false)] {
        for (cut, why) in (0..STEPS).flat_map(|cut| ENDINGS.map(|why| (cut, why))) {
            let mut board = Board::new(reports, report_runs);
            let reply = drive(&mut a_gather(), &mut board, (cut, why), (usize::MAX, Outcome::Done));
            let found = (board.gathers, board.followed, board.period.as_str());
            assert_eq!(found, (false, false, "1"), "{reports} {report_runs} {cut} {why}: {reply:?}");
            assert!(
                board.report_runs || !report_runs,
                "{cut} {why}: everybody's servo report has been ended"
            );
        }
    }
}

#[test]
fn a_gather_of_which_a_step_fails_leaves_the_board_as_it_was_and_is_followed_no_more() {
    for (reports, report_runs) in [(true, true), (true, false), (false, false)] {
        // The steps of the end come after the owner's.
        for fails in 0..2 * STEPS {
            for outcome in [
                Outcome::TimedOut,
                Outcome::Interrupted(Text::of(&"^X")),
                Outcome::Busy,
                Outcome::Unavailable { port: CommandPort::Dpram, page: None },
            ] {
                let mut board = Board::new(reports, report_runs);
                let ends = (STEPS, Ending::OwnerGone);
                let reply = drive(&mut a_gather(), &mut board, ends, (fails, outcome));
                assert!(
                    board.report_runs || !report_runs,
                    "{fails} {outcome:?}: everybody's servo report has been ended"
                );
                let is_told = format!("{reply:?}").contains("may ");
                let is_as_before = !board.gathers && board.period == "1";
                assert!(is_as_before || is_told, "{fails} {outcome:?}: {board:?} {reply:?}");
                assert!(!board.followed, "{reports} {report_runs} {fails} {outcome:?}: {reply:?}");
            }
        }
    }
}

fn stream(left: Option<calls::LeftLines>) -> Script {
    stream_beside(&PMAC, 1, left, &Entry::default())
}

/// The stream into coordinate system `cs` beside the other streams of `entry`.
fn stream_beside(family: &'static Family, cs: u8, left: Option<calls::LeftLines>, entry: &Entry) -> Script {
    let call = calls::RotaryStart {
        buffer: cs,
        start: None,
        size_longs: Some(40),
        coordinate_system: cs,
        coordinate_system_base: 1,
        define_longs: None,
        left,
        // The board counts one program's lines.
        run: Some(cs == 1),
        may_stand: None,
        modes: Vec::new(),
    };
    rotary(RotaryCall::of(call, &info_of(family)).unwrap(), entry.clone())
}

/// Takes steps of `machine` until it is over, or has taken `count` steps. `done` is the step that it hears of next.
fn advance(machine: &mut Script, board: &mut Board, done: &mut Option<Done>, count: usize) {
    let (mut now, mut steps) = (Instant::now(), 0);
    while steps < count {
        match machine.next(done.take(), now) {
            Step::Over(_) => return,
            Step::Wait(moment) => now = moment,
            Step::Rest | Step::Answer(_) | Step::Tell(_) | Step::AnswerEnd(_) => {}
            Step::Board(request, _) => {
                *done = Some(board.take(&request, Outcome::Done));
                steps += 1;
            }
        }
    }
}

#[test]
fn the_last_stream_closes_what_another_one_opened_however_far_it_came() {
    for (family, cut, order) in [&PMAC, &TURBO2]
        .into_iter()
        .flat_map(|family| (0..STEPS).map(move |cut| (family, cut)))
        .flat_map(|(family, cut)| [[0, 1], [1, 0]].map(|order| (family, cut, order)))
    {
        let (mut board, entry) = (Board::new(true, true), Entry::default());
        let mut streams = [1, 2].map(|cs| (stream_beside(family, cs, None, &entry), None));
        for ((machine, done), count) in streams.iter_mut().zip([STEPS, cut]) {
            advance(machine, &mut board, done, count);
        }
        assert!(board.open, "{} {cut}: the first one has opened", family.name);
        for index in order {
            let (machine, done) = &mut streams[index];
            machine.end(Ending::OwnerGone);
            advance(machine, &mut board, done, 4 * STEPS);
        }
        assert!(!board.open && !board.transfer, "{} {cut} {order:?}: {board:?}", family.name);
    }
}

#[test]
fn a_stream_cut_anywhere_leaves_no_program_running_and_no_line_on_its_way() {
    for left in [0, 497] {
        for (cut, why) in (0..STEPS).flat_map(|cut| ENDINGS.map(|why| (cut, why))) {
            let mut board = Board { left, ..Board::new(true, true) };
            let mut machine = stream((left > 0).then_some(calls::LeftLines::Clear));
            let reply = drive(&mut machine, &mut board, (cut, why), (usize::MAX, Outcome::Done));
            let is_fed = board.open || board.transfer || board.fed;
            assert!(!board.runs && !is_fed, "{cut} {why}: {board:?} {reply:?}");
        }
    }
}

#[test]
fn a_stream_of_which_a_step_fails_leaves_no_program_running_and_no_line_on_its_way() {
    for fails in 0..2 * STEPS {
        for outcome in [Outcome::TimedOut, Outcome::Interrupted(Text::of(&"^X")), Outcome::Busy] {
            let mut board = Board::new(true, true);
            let ends = (STEPS, Ending::OwnerGone);
            let reply = drive(&mut stream(None), &mut board, ends, (fails, outcome));
            let is_told = format!("{reply:?}").contains("may ");
            let is_ended = !board.runs && !board.open && !board.transfer;
            assert!(is_ended || is_told, "{fails} {outcome:?}: {board:?} {reply:?}");
            assert!(!board.fed, "{fails} {outcome:?}: lines still go into the DPRAM: {reply:?}");
        }
    }
}

fn a_download() -> Script {
    let text = |lines: &[&str]| lines.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>();
    let call = calls::RunLines {
        kind: "download".to_owned(),
        lines: text(&["P1=5", "OPEN PROG 1", "X1", "X2"]),
        timeout_ms: None,
        keep_going: None,
        at_end: Some(text(&["P1=0"])),
        last: None,
        confirmed: None,
    };
    lines(Batch::of(call).unwrap())
}

#[test]
fn a_download_cut_anywhere_leaves_no_buffer_open_and_its_variable_as_it_was() {
    for (cut, why) in (0..STEPS).flat_map(|cut| ENDINGS.map(|why| (cut, why))) {
        let mut board = Board::new(true, true);
        let reply = drive(&mut a_download(), &mut board, (cut, why), (usize::MAX, Outcome::Done));
        assert_eq!((board.program_open, board.p1.as_str()), (false, "0"), "{cut} {why}: {reply:?}");
    }
}

#[test]
fn a_download_of_which_a_step_fails_leaves_no_buffer_open_and_its_variable_as_it_was() {
    for fails in 0..2 * STEPS {
        for outcome in [Outcome::TimedOut, Outcome::Interrupted(Text::of(&"^X")), Outcome::Busy] {
            let mut board = Board::new(true, true);
            let ends = (STEPS, Ending::OwnerGone);
            let reply = drive(&mut a_download(), &mut board, ends, (fails, outcome));
            let is_as_before = !board.program_open && board.p1 == "0";
            let is_told = format!("{reply:?}").contains("failed");
            assert!(is_as_before || is_told, "{fails} {outcome:?}: {board:?} {reply:?}");
        }
    }
}

#[test]
fn lines_that_are_left_are_refused_with_their_number() {
    let mut board = Board { left: 497, ..Board::new(true, true) };
    let before = board.clone();
    let reply = drive(&mut stream(None), &mut board, (STEPS, Ending::OwnerGone), (usize::MAX, Outcome::Done));
    let Err(CallError::Refused { reason }) = reply else { panic!("{reply:?}") };
    assert!(reason.contains("497 lines") && reason.contains("--clear"), "{reason}");
    assert_eq!(Board { timer: before.timer, ..board }, before, "nothing was changed");
}

/// Drives `machine` until it rests for the `count`th time while the board gathers, or the daemon feeds it. Then calls
/// `happens`. Returns the text of the end, and how long the end took.
fn disturbed(
    machine: &mut Script,
    board: &mut Board,
    count: usize,
    happens: impl Fn(&mut Board),
) -> (String, Duration) {
    let (mut now, mut done, mut rests) = (Instant::now(), None, 0);
    let mut since = now;
    for _ in 0..20 * STEPS {
        match machine.next(done.take(), now) {
            Step::Over(reply) => return (format!("{reply:?}"), now - since),
            Step::Wait(moment) => {
                now = moment;
                rests += usize::from(board.gathers || board.open);
                if rests == count {
                    rests += 1;
                    happens(board);
                    since = now;
                }
            }
            Step::Rest | Step::Answer(_) | Step::Tell(_) | Step::AnswerEnd(_) => {}
            Step::Board(request, _) => done = Some(board.take(&request, Outcome::Done)),
        }
    }
    panic!("it goes on: {machine:?}");
}

const SOON: Duration = Duration::from_secs(1);

#[test]
fn a_stream_notices_that_its_program_does_not_run_any_more() {
    let mut board = Board::new(true, true);
    // A user on another host stops the program.
    let (said, took) = disturbed(&mut stream(None), &mut board, 2, |board| board.runs = false);
    assert!(said.contains("does not run its rotary program any more") && took <= SOON, "{took:?} {said}");
    assert!(!board.open && !board.transfer);
}

#[test]
fn the_end_of_a_stream_waits_until_somebody_elses_buffer_is_closed() {
    let (mut machine, mut board) = (stream(None), Board::new(true, true));
    let (mut now, mut done, mut closed_at, mut told) = (Instant::now(), None, None, None);
    for _ in 0..20 * STEPS {
        match machine.next(done.take(), now) {
            Step::Over(_) => break,
            Step::Wait(moment) => now = moment,
            Step::AnswerEnd(reply) => told = Some(reply),
            Step::Rest | Step::Answer(_) | Step::Tell(_) => {}
            Step::Board(request, _) => {
                if board.runs && closed_at.is_none() {
                    // The owner dies, and another user opens a buffer for twenty seconds.
                    closed_at = Some(now + Duration::from_secs(20));
                    board.open = false;
                    machine.end(Ending::OwnerGone);
                }
                let is_line = matches!(request, Request::Line(_) | Request::Ask(_));
                let is_barred = is_line && closed_at.is_some_and(|moment| now < moment);
                let outcome = if is_barred { Outcome::Barred(Barred::Open(None)) } else { Outcome::Done };
                done = Some(board.take(&request, outcome));
            }
        }
    }
    let told = format!("{told:?}");
    assert!(told.contains("&1 may still run it (abort 1 ends that)"), "{told}");
    assert!(!board.runs && !board.transfer && machine.unfinished().is_none(), "{board:?}");
}

#[test]
fn a_stream_notices_within_a_second_that_somebody_closed_its_buffer() {
    // The report tells, or the daemon asks if no report comes.
    for report_runs in [true, false] {
        let mut board = Board::new(true, report_runs);
        let (said, took) = disturbed(&mut stream(None), &mut board, 4, |board| board.open = false);
        assert!(said.contains("somebody sent CLOSE") && took <= 2 * SOON, "{took:?} {said}");
        assert!(!board.runs && !board.transfer);
    }
}

#[test]
fn a_gather_notices_that_the_board_was_reset_or_gathers_no_more() {
    for (reports, report_runs) in [(true, true), (true, false), (false, false)] {
        let mut board = Board::new(reports, report_runs);
        let (said, took) = disturbed(&mut a_gather(), &mut board, 3, Board::reset);
        assert!(
            said.contains("the board was reset, which ended the gather") && took <= SOON,
            "{took:?} {said}"
        );
        let mut board = Board::new(reports, report_runs);
        let (said, took) = disturbed(&mut a_gather(), &mut board, 3, |board| board.gathers = false);
        assert!(said.contains("the board gathers no more") && took <= SOON, "{took:?} {said}");
        assert_eq!(board.period, "1");
    }
}

#[test]
fn a_report_that_comes_too_seldom_is_not_waited_for() {
    let mut board = Board { period: "8000000".to_owned(), ..Board::new(true, true) };
    let before = board.clone();
    let ends = (STEPS, Ending::OwnerGone);
    let reply = drive(&mut a_gather(), &mut board, ends, (usize::MAX, Outcome::Done));
    let Err(CallError::Refused { reason }) = reply else { panic!("{reply:?}") };
    assert!(reason.contains("once in 3541 s") && reason.contains("I19 is 8000000"), "{reason}");
    assert_eq!(board, before, "nothing was sent");
}
