//! Whole screens.

use std::time::{Duration, Instant};

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::style::Color;
use serde_json::{Value, json};

use super::{Look, Picture};
use crate::cli::show::coordinates::Overrides;
use crate::cli::top::asker::DaemonAnswer;
use crate::cli::top::hand::Told;
use crate::cli::top::state::{Page, ScreenState};
use crate::cli::top::trace::Traces;
use crate::cli::top::watches::Watched;
use crate::client::number::NOT_READ;
use crate::client::{Snapshot, Staleness, UserData, UserValues, View, identity};
use crate::decode::{self, Image, Quantity};
use crate::format::{Float48Layout, WordOrder, fixed48, int24, split32};
use crate::map::user_word::UserWord;
use crate::map::{Family, HostOffset, PMAC, Space, TURBO2, TypedAddress, block_fields};
use crate::segment::{Identity, UserUnit};

/// The data of a picture.
struct Board {
    now: Instant,
    snapshot: Result<Snapshot, String>,
    answer: Option<DaemonAnswer>,
    traces: Traces,
    state: ScreenState,
}

fn view<T>(data: T) -> View<T> {
    View { sequence: 8864, time_ns: 0, realtime_ns: 0, age_ns: 0, servo_timer: 0, stale: None, data }
}

fn status(condition: &str, reason: Value) -> Value {
    json!({
        "name": "pmac0", "condition": condition, "reason": reason, "owner_pid": 77, "heartbeat_age_ms": 12.0,
        "uptime_s": 90.0, "board": { "family": "pmac", "firmware": "1.16D" }, "global_status": null, "regions": {},
        "counters": { "updates": 8864, "lost": 0, "missed": 2, "skipped": 0, "retries": 1, "bus_errors": 0 },
        "socket": { "reachable": true, "path": "/run/pmacd/pmac0.sock", "functions": [], "command_port": "dpram",
            "open_buffer": { "text": "PROG 7 is open: opened by uid 1000" } },
    })
}

impl Board {
    /// Motor 1 has followed with an error, and coordinate system 1 runs a program.
    fn of(family: &'static Family, motors: usize) -> Self {
        let mut identity = Identity::default();
        identity.ix08[..motors].fill(Some(96));
        identity.ix09[..motors].fill(Some(96));
        identity.ix60[..motors].fill(Some(0));
        identity.i10 = Some(3_713_707);
        identity.family = Some(family.number);
        identity.names[1] = Some("azimuth".into());
        identity.units[1] = Some(UserUnit { name: "deg".into(), counts_per_unit: -1000.0 });
        let mut bytes = vec![0; usize::try_from(family.length).unwrap()];
        let mut put = |offset: usize, value: u32| {
            for (index, word) in split32(value).into_iter().enumerate() {
                bytes[offset + 2 * index..][..2].copy_from_slice(&word.to_le_bytes());
            }
        };
        // Activated, the loop open.
        let word = block_fields(family, "servo").find(|field| field.name == "servo_status").unwrap();
        for number in 1..=motors {
            let block = family.servo.motors.at(number).unwrap();
            put(block.plus_words(word.words.start).bytes() as usize, int24::extend(0x84_2000));
        }
        if family.name == "pmac" {
            let [y, x] = fixed48::encode(3072 * 12_345);
            put(0x48 + 8, y);
            put(0x48 + 12, x);
            put(0x48 + 0x24, int24::extend(0x81_2000));
            put(0x48 + 0x3C + 0x24, int24::extend(0x80_0000));
            put(0x24C + 0x10, int24::extend(0x80_4401));
            put(0x24C + 0x18, 1);
            put(0x24C + 0x68, 3);
        }
        if let Some(mask) = family.servo.mask {
            bytes[2 * mask.word()..][..4].fill(0xFF);
        }
        let image = Image::from_bytes(&bytes, family, WordOrder::Little).unwrap();
        let scales = identity::scales(&identity);
        let servo = image.servo(motors, &scales).unwrap();
        let systems = family.background.reported(motors).min(family.coordinate_systems);
        let background = image.background(systems, &scales, Float48Layout::default()).unwrap();
        let now = Instant::now() + Duration::from_secs(60);
        let mut traces = Traces::default();
        for (ago, error) in [(19, 1.0), (12, -40.0), (6, 10.0), (1, 25.0), (0, 0.0)] {
            let mut servo = servo.clone();
            servo.motors[0].following_error = Some(Quantity { raw: 0, value: Some(error), unit: "count" });
            traces.add(&[view(servo)], false, now - Duration::from_secs(ago));
        }
        let mut state = ScreenState::new(Vec::new());
        state.saw((1..=motors).collect(), systems, true);
        let (servo, background) = (Some(view(servo)), Some(view(background)));
        let snapshot = Snapshot { identity, servo, background, user: None, stale: None };
        let watched = Watched { values: vec![("P1".to_owned(), "5".to_owned())], fault: None };
        let answer = DaemonAnswer {
            at: now,
            status: status("live", Value::Null),
            overrides: Overrides::default(),
            watched,
        };
        Self { now, snapshot: Ok(snapshot), answer: Some(answer), traces, state }
    }

    fn stale(mut self, stale: Staleness) -> Self {
        let snapshot = self.snapshot.as_mut().unwrap();
        snapshot.servo.as_mut().unwrap().stale = Some(stale);
        snapshot.background.as_mut().unwrap().stale = Some(stale);
        self
    }

    fn terminal(&self, width: u16, height: u16, colours: bool) -> Terminal<TestBackend> {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        let picture = Picture {
            name: "/pmac0",
            snapshot: self.snapshot.as_ref().map_err(String::as_str),
            answer: self.answer.as_ref(),
            traces: &self.traces,
            state: &self.state,
            look: Look::new(colours),
            now: self.now,
        };
        terminal.draw(|frame| picture.draw(frame)).unwrap();
        terminal
    }

    /// The screen's lines, without the blanks at their ends.
    fn screen(&self, width: u16, height: u16) -> Vec<String> {
        let terminal = self.terminal(width, height, true);
        let cells = terminal.backend().buffer().content().chunks(width.into());
        let line =
            |cells: &[ratatui::buffer::Cell]| cells.iter().map(|cell| cell.symbol()).collect::<String>();
        cells.map(|cells| line(cells).trim_end().to_owned()).collect()
    }
}

#[track_caller]
fn assert_screen(board: &Board, width: u16, height: u16, golden: &str) {
    let screen = board.screen(width, height);
    assert_eq!(screen, golden.lines().collect::<Vec<_>>(), "\n{}", screen.join("\n"));
}

#[test]
fn of_a_replay_that_is_over_the_cable_is_not_to_be_looked_at() {
    let mut board = Board::of(&PMAC, 8).stale(Staleness::BoardSilent);
    let screen = |board: &Board| board.screen(160, 30).join("\n");
    assert!(screen(&board).contains("cable"), "{}", screen(&board));
    board.answer.as_mut().unwrap().status["socket"]["replay"] = json!({ "over": true });
    let shown = screen(&board);
    assert!(shown.contains("STALE: the recording is over") && !shown.contains("cable"), "{shown}");
}

#[test]
fn a_screen_of_80_by_24_has_everything() {
    assert_screen(&Board::of(&PMAC, 8), 80, 24, include_str!("screens/80x24"));
}

#[test]
fn a_large_screen_has_more_of_it() {
    assert_screen(&Board::of(&PMAC, 8), 120, 40, include_str!("screens/120x40"));
}

#[test]
fn a_replay_says_so_on_every_page_and_every_screen() {
    let mut board = Board::of(&PMAC, 8);
    board.snapshot.as_mut().unwrap().identity.replay = true;
    assert_screen(&board, 80, 24, include_str!("screens/replay"));
    for page in [Page::Board, Page::Status, Page::Help] {
        board.state.page = page;
        for (width, height) in [(80, 24), (40, 10), (20, 2)] {
            let screen = board.screen(width, height);
            assert!(screen[0].starts_with(" REPLAY, no board"), "{page:?}: {screen:#?}");
        }
    }
    let title = |board: &Board| board.terminal(80, 24, true).backend().buffer()[(1, 0)].fg;
    assert_eq!(title(&board), Color::Yellow);
    board.snapshot.as_mut().unwrap().identity.replay = false;
    assert_eq!(title(&board), Color::Reset);
}

#[test]
fn values_that_the_screen_has_no_room_for_are_counted() {
    let mut board = Board::of(&PMAC, 8);
    let values = (0..200).map(|number| (format!("P{number}"), "1234567".to_owned()));
    board.answer.as_mut().unwrap().watched.values = values.collect();
    let screen = board.screen(80, 24);
    assert!(screen[22].starts_with("P") && screen[22].ends_with(" +33 more lines"), "{screen:#?}");
    assert!(screen.iter().any(|line| line.starts_with("P0=1234567  P1=1234567")), "{screen:#?}");
}

#[test]
fn a_small_screen_keeps_the_motors() {
    let mut board = Board::of(&PMAC, 8);
    board.state.selected = 8;
    assert_screen(&board, 40, 10, include_str!("screens/40x10"));
}

#[test]
fn of_32_motors_those_around_the_selected_one_are_shown() {
    let mut board = Board::of(&TURBO2, 32);
    board.state.selected = 30;
    let screen = board.screen(80, 24);
    assert!(screen.iter().any(|line| line.trim_start().starts_with("#30 ")), "{screen:#?}");
    assert!(!screen.iter().any(|line| line.trim_start().starts_with("#1 ")), "{screen:#?}");
    let terminal = board.terminal(80, 24, true);
    let reversed = ratatui::style::Modifier::REVERSED;
    let row = screen.iter().position(|line| line.trim_start().starts_with("#30 ")).unwrap();
    let cell = &terminal.backend().buffer()[(4, u16::try_from(row).unwrap())];
    assert!(cell.modifier.contains(reversed), "the selected motor is marked");
}

#[test]
fn a_board_that_reports_no_velocity_tells_it_by_its_positions() {
    let mut board = Board::of(&TURBO2, 2);
    let seen = board.snapshot.as_ref().unwrap().servo.as_ref().unwrap().data.clone();
    let add = |board: &mut Board, ms: u64, counts: f64, stale: bool| {
        let mut data = seen.clone();
        data.motors[1].actual_position = Some(Quantity { raw: 0, value: Some(counts), unit: "count" });
        board.traces.add(&[View { time_ns: 1_000_000 * ms, ..view(data) }], stale, board.now);
    };
    let velocity = |board: &Board| {
        let screen = board.screen(80, 24);
        let heading = screen.iter().find(|line| line.contains("motor ")).unwrap();
        assert!(heading.contains("velocity"), "{screen:#?}");
        let motor = screen.iter().find(|line| line.trim_start().starts_with("#2 ")).unwrap();
        motor.contains("-2500.0")
    };
    add(&mut board, 1000, 100.0, false);
    assert!(!velocity(&board), "of one update nothing is known");
    add(&mut board, 1100, -150.0, false);
    assert!(velocity(&board));
    board.traces.add(&[], false, board.now);
    assert!(velocity(&board), "two pictures of one update");
    add(&mut board, 1200, -400.0, true);
    assert!(!velocity(&board), "stale");
}

#[test]
fn what_is_not_live_says_so_and_why() {
    let said = |board: &Board| board.screen(80, 24)[1].clone();
    let board = Board::of(&PMAC, 8).stale(Staleness::DaemonGone);
    assert_eq!(said(&board), "STALE: pmacd is gone; start it");
    let mut board = Board::of(&PMAC, 8);
    board.snapshot = Err("the segment is corrupt".to_owned());
    assert_eq!(said(&board), "no data: the segment is corrupt");
    let mut board = Board::of(&PMAC, 8);
    board.answer.as_mut().unwrap().status = status("unreachable", json!("nobody answers"));
    assert_eq!(said(&board), "unreachable: nobody answers");
    let mut board = Board::of(&PMAC, 8);
    board.now += Duration::from_secs(5);
    assert_eq!(said(&board), "pmacd has not answered for 5 s");
}

#[test]
fn words_of_the_site_stand_before_the_watches_and_old_ones_have_no_value() {
    let word = |name: &str, space, count| UserWord {
        name: name.into(),
        unit: "mm".into(),
        location: TypedAddress { space, offset: HostOffset::new(0x2840) },
        bits: None,
        signed: true,
        count,
        guard: None,
    };
    let one = UserValues { word: word("count", Space::Dp, 1), values: Some(vec![decode::Value::Long(-7)]) };
    let pair = vec![decode::Value::Word(1), decode::Value::Word(2)];
    let two = UserValues { word: word("pair", Space::Y, 2), values: Some(pair) };
    let held = UserValues { word: word("held", Space::Dp, 1), values: None };
    let mut board = Board::of(&PMAC, 8);
    let user = &mut board.snapshot.as_mut().unwrap().user;
    *user = Some(view(UserData { words: vec![one, two, held] }));
    let shown = |board: &Board, line: &str| {
        let screen = board.screen(80, 24);
        assert!(screen.iter().any(|shown| shown == line), "{screen:#?}");
    };
    shown(&board, "count=-7 mm  pair=1 2 mm  held=not whole  P1=5");
    board.snapshot.as_mut().unwrap().user.as_mut().unwrap().stale =
        Some(Staleness::NoUpdates { age_ns: 2_000_000_000 });
    shown(&board, &format!("count={NOT_READ}  pair={NOT_READ}  held={NOT_READ}  P1=5"));
    board.answer = None;
    shown(&board, &format!("count={NOT_READ}  pair={NOT_READ}  held={NOT_READ}"));
}

#[test]
fn without_colours_nothing_is_coloured_and_all_is_said() {
    let mut board = Board::of(&PMAC, 8).stale(Staleness::DaemonGone);
    board.state.told(Told::Fault("the jog is over".to_owned()), board.now);
    let colours = |colours: bool| {
        let terminal = board.terminal(80, 24, colours);
        let content = terminal.backend().buffer().content().to_vec();
        content.iter().filter(|cell| cell.fg != Color::Reset || cell.bg != Color::Reset).count()
    };
    assert!(colours(true) > 0);
    assert_eq!(colours(false), 0);
}

#[test]
fn no_warning_is_cut() {
    let mut board = Board::of(&PMAC, 8);
    let warning = crate::cli::act::hold::may_be_moving(&[1]);
    board.state.told(Told::Fault(warning.clone()), board.now);
    for width in [40, 80, 200] {
        let screen = board.screen(width, 24).join(" ");
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words(&screen).contains(&words(&warning)), "{width}: {screen}");
    }
}

#[test]
fn the_pages_of_text_can_be_read_on_any_screen() {
    let mut board = Board::of(&PMAC, 8);
    for (page, first, last) in [(Page::Help, "up, k", "emergency"), (Page::Status, "name", "open buffer")] {
        board.state.page = page;
        board.state.turned = 0;
        assert!(board.screen(80, 24).join("\n").contains(last), "{page:?} fits: {:#?}", board.screen(80, 24));
        assert!(board.screen(40, 10).join("\n").contains(first), "{page:?}");
        board.state.turned = 99;
        assert!(board.screen(40, 10).join("\n").contains(last), "{page:?}: {:#?}", board.screen(40, 10));
    }
}

#[test]
fn nothing_breaks_on_a_screen_of_any_size() {
    let mut board = Board::of(&PMAC, 8);
    for page in [Page::Board, Page::Help, Page::Status] {
        board.state.page = page;
        for (width, height) in (0..12).flat_map(|width| (0..12).map(move |height| (width, height))) {
            board.screen(width.max(1), height);
        }
    }
}
