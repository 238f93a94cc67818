//! The DPRAM ASCII port, with a host on the other side.

use crate::sim::board::error::CommandError;
use crate::sim::board::turbo;
use crate::sim::program::item::Message;
use crate::sim::program::message::{Outlet, send};
use crate::sim::testing::Bench;

fn ack() -> (u16, String) {
    (0x0006, String::new())
}

fn line(text: &str) -> (u16, String) {
    (0x000D, text.into())
}

#[test]
fn a_line_is_answered_line_by_line_and_acknowledged() {
    let mut bench = Bench::started();
    assert_eq!(bench.send("I10 VERSION"), [line("3713707"), line("1.16D"), ack()]);
    assert_eq!(bench.send(""), [ack()]);
    assert_eq!(bench.read(0x062C), 0);
    assert_eq!(bench.world.ascii.commands, 2);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn an_error_is_a_bcd_word() {
    let mut bench = Bench::started();
    assert_eq!(bench.send("UUU"), [(0x8003, String::new())]);
    assert_eq!(bench.send("I19 #99"), [line("1"), (0x8003, String::new())]);
    bench.world.board.output.respond_error(CommandError(17));
    assert_eq!(bench.response(), (0x8017, String::new()));
}

#[test]
fn nothing_is_written_while_the_host_has_not_freed_the_buffer() {
    let mut bench = Bench::started();
    bench.write_text("I19 I59");
    bench.write(0x062C, 1);
    bench.run(20);
    assert_eq!((bench.read(0x06D0), bench.read(0x06D2), bench.read(0x06D4)), (0x000D, 2, u16::from(b'1')));
    bench.run(20);
    assert_eq!(bench.read(0x06D4), u16::from(b'1'));
    assert_eq!(bench.world.interrupts.response, 1);
    assert_eq!([bench.response(), bench.response(), bench.response()], [line("1"), line("8"), ack()]);
    assert_eq!(bench.world.interrupts.response, 3);
}

/// "The control word has to be 0 before PMAC writes" (manual p. 28): a board waits, however much it has to say.
#[test]
fn a_reply_is_whole_however_many_lines_it_has() {
    let mut turbo = Bench::of(&turbo::TURBO2, turbo::TURBO2.firmware);
    turbo.set(4, 0.0);
    let mut pmac = Bench::started();
    for line in std::iter::once("OPEN PROG 1 CLEAR".to_owned())
        .chain((0..5000).map(|number| format!("X{number}")))
        .chain(["CLOSE".to_owned()])
    {
        assert_eq!(pmac.world.execute(line.as_bytes()).error, None, "{line}");
    }
    let mut benches = [turbo, pmac];
    for (bench, question, lines, last) in [
        (0, "I0..8191", 8192, None),
        (1, "LIST PROG 1", 5001, Some("RET")),
        (1, "I0..1023 I0..1023 I0..1023 I0..1023 I10", 4097, Some("3713707")),
    ] {
        let bench = &mut benches[bench];
        bench.offer(question);
        // The board takes its time for a long listing.
        bench.until(40_000, |board| !board.output.dpram.is_empty());
        // Another line waits: the board takes it only when it has room.
        bench.offer("I4");
        // A report that is asked for meanwhile comes behind.
        bench.write(bench.world.board.family().ascii.control_character.bytes(), 0x03);
        bench.run(5);
        let mut replies: Vec<_> = (0..=lines).map(|_| bench.response()).collect();
        assert_eq!(replies.pop(), Some(ack()), "{question}");
        assert!(replies.iter().all(|(control, _)| *control == 0x000D), "{question}");
        if let Some(last) = last {
            assert_eq!(replies.pop(), Some(line(last)), "{question}");
        }
        for what in ["^C", "I4"] {
            assert_eq!([bench.response().0, bench.response().0], [0x000D, 0x0006], "{question} {what}");
        }
        assert!(bench.violations().is_empty(), "{question}: {:?}", bench.violations());
    }
}

/// No host waits for unasked text: the judge reports its loss once.
#[test]
fn messages_that_no_host_fetches_are_lost_and_told() {
    let mut bench = Bench::started();
    bench.world.board.dpram_becomes_active();
    let kept = 4096;
    for _ in 0..3 * kept {
        send(&mut bench.world.board, &Message::Text("hello".into()), Outlet::Active);
    }
    bench.run(10);
    let output = &bench.world.board.output;
    assert_eq!((output.dpram.len() + 1, output.lost), (kept, 2 * kept as u64));
    let told = bench.violations().to_vec();
    assert!(told.len() == 1 && told[0].contains("no host fetches the responses"), "{told:?}");
    // A stop is carried out all the same.
    bench.write(0x062E, 1);
    bench.run(10);
    assert_eq!(bench.read(0x062E), 0);
}

#[test]
fn a_long_line_comes_in_two_parts() {
    let mut bench = Bench::started();
    let text = format!("{:159}{:36}I19", "", "");
    bench.write_text(&text[..159]);
    // The byte after the first part says that a second part follows.
    bench.write(0x06CE, 0x2020);
    bench.write(0x062C, 1);
    bench.run(5);
    assert_eq!((bench.read(0x062C), bench.read(0x06D0)), (0, 0));
    assert_eq!(bench.send(&text[159..]), [line("1"), ack()]);
    // 159 characters and their NUL are a whole line.
    assert_eq!(bench.send(&format!("{:156}I59", "")), [line("8"), ack()]);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn more_than_two_hundred_characters_are_an_error() {
    let mut bench = Bench::started();
    bench.write_text(&" ".repeat(159));
    bench.write(0x06CE, 0x2020);
    bench.write(0x062C, 1);
    bench.run(5);
    assert_eq!(bench.send(&format!("{:39}I19", "")), [(0x8003, String::new())]);
    assert_eq!(bench.send("I19"), [line("1"), ack()]);
}

#[test]
fn control_characters_act_at_once_and_silently() {
    let mut bench = Bench::started();
    bench.world.board.jog(0, crate::sim::board::jog::Jog::Plus, None).unwrap();
    bench.run(100);
    bench.write(0x062E, 11);
    bench.run(1);
    assert_eq!(bench.read(0x062E), 0);
    assert_eq!(bench.world.board.motor_status(0)[0] & 1 << 18, 1 << 18, "killed");
    bench.run(20);
    assert_eq!(bench.read(0x06D0), 0);
}

#[test]
fn cancel_empties_the_queue_and_both_words() {
    let mut bench = Bench::started();
    bench.write_text("I19 I59 I48");
    bench.write(0x062C, 1);
    bench.run(5);
    assert_eq!(bench.read(0x06D0), 0x000D);
    bench.write(0x062E, 24);
    bench.run(5);
    assert_eq!((bench.read(0x06D0), bench.read(0x062C)), (0, 0));
    assert!(bench.violations().is_empty());
}

#[test]
fn without_i58_the_port_is_deaf() {
    let mut bench = Bench::started();
    bench.world.board.serial_becomes_active();
    bench.write_text("I19");
    bench.write(0x062C, 1);
    bench.write(0x062E, 11);
    bench.run(20);
    assert_eq!((bench.read(0x062C), bench.read(0x062E), bench.read(0x06D0)), (1, 11, 0));
}

#[test]
fn while_a_slow_line_is_at_work_the_board_looks_at_nothing_else() {
    let mut bench = Bench::started();
    bench.world.board.faults.ascii_slow = 100;
    bench.write_text("P7=P7+1 P7");
    bench.write(0x062C, 1);
    bench.run(50);
    assert_eq!((bench.read(0x062C), bench.read(0x06D0)), (0, 0));
    bench.write(0x062E, 11);
    bench.run(20);
    assert_eq!(bench.read(0x062E), 11);
    bench.run(50);
    assert_eq!(bench.read(0x062E), 0);
    assert_eq!([bench.response(), bench.response()], [line("1"), ack()]);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn faults_of_the_port() {
    let mut bench = Bench::started();
    bench.world.board.faults.ascii_late_ack = 30;
    bench.write_text("I19");
    bench.write(0x062C, 1);
    assert_eq!(bench.response(), line("1"));
    bench.run(25);
    assert_eq!(bench.read(0x06D0), 0);
    bench.run(10);
    assert_eq!(bench.response(), ack());
    bench.world.board.faults.ascii_late_ack = 0;
    bench.world.board.faults.ascii_no_reply = true;
    bench.write(0x062C, 1);
    bench.run(20);
    assert_eq!((bench.read(0x062C), bench.read(0x06D0)), (0, 0));
    bench.world.board.faults.ascii_deaf = true;
    bench.write(0x062C, 1);
    bench.run(20);
    assert_eq!(bench.read(0x062C), 1);
}

#[test]
fn unsolicited_messages_have_words_of_their_own() {
    use crate::sim::control::{ControlAnswer, execute};
    let mut bench = Bench::started();
    bench.send("");
    assert_eq!(execute(&mut bench.world, "send AT HOME", true), ControlAnswer::Line("ok".into()));
    assert_eq!(execute(&mut bench.world, "cmd I19 I59", true), ControlAnswer::Line("ok".into()));
    assert_eq!(bench.response(), (0x020D, "AT HOME".into()));
    assert_eq!(bench.response(), (0x010D, "1".into()));
    assert_eq!(bench.response(), (0x010D, "8".into()));
    bench.world.board.serial_becomes_active();
    assert_eq!(execute(&mut bench.world, "send DONE", true), ControlAnswer::Line("ok".into()));
    assert_eq!(bench.world.board.output.serial, b"DONE\r");
}

#[test]
fn the_judge_sees_what_a_host_must_not_do() {
    let mut bench = Bench::started();
    bench.write_text("I19");
    bench.write(0x062C, 1);
    bench.run(1);
    bench.write_text("I59");
    assert_eq!([bench.response(), bench.response()], [line("8"), ack()]);
    assert!(bench.violations()[0].contains("command text changed"), "{:?}", bench.violations());

    for (offset, value, cycles) in
        [(0x0026, 7, 1), (0x06D2, 9, 1), (0x06D0, 6, 1), (0x0228, 3, 1), (0x01F4, 1, 200), (0x0600, 1, 200)]
    {
        let mut bench = Bench::started();
        bench.set(19, 1000.0);
        bench.run(2);
        bench.write(offset, value);
        bench.run(cycles);
        assert_eq!(bench.violations().len(), 1, "{offset:#06x} {:?}", bench.violations());
        assert!(bench.violations()[0].contains(&format!("0x{offset:04X}")), "{:?}", bench.violations());
    }
    // A write to the host's own words is no finding.
    let mut bench = Bench::started();
    for offset in [0x0000, 0x0004, 0x0024, 0x0800, 0x07EC] {
        bench.write(offset, 0);
    }
    bench.write(0x0228, 0);
    bench.run(300);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn control_w_takes_the_line_that_i47_points_to() {
    let mut bench = Bench::started();
    bench.set(47, f64::from(0xD300));
    for (index, pair) in b"P7=42 P7..8\0".chunks(2).enumerate() {
        bench.write(0x0C00 + 2 * index as u32, u16::from_le_bytes([pair[0], pair[1]]));
    }
    bench.write(0x062E, 0x17);
    assert_eq!([bench.response(), bench.response(), bench.response()], [line("42"), line("0"), ack()]);
    // A line without data is acknowledged; one that is not in the DPRAM is empty.
    bench.write(0x0C04, u16::from(b'2'));
    bench.write(0x062E, 0x17);
    assert_eq!(bench.response(), ack());
    bench.set(47, f64::from(0x1000));
    bench.write(0x062E, 0x17);
    assert_eq!(bench.response(), ack());
}

#[test]
fn torn_repeated_and_miscounted_responses_are_what_their_faults_say() {
    let mut bench = Bench::started();
    bench.world.board.faults.ascii_repeat = true;
    assert_eq!(bench.send("I59"), [line("8"), line("8"), ack()]);
    assert_eq!(bench.response(), ack());
    bench.world.board.faults.ascii_repeat = false;
    bench.world.board.faults.ascii_count = Some(77);
    bench.write_text("VERSION I10");
    bench.write(0x062C, 1);
    bench.run(5);
    assert_eq!((bench.read(0x06D0), bench.read(0x06D2)), (0x000D, 77));
    bench.world.board.faults.ascii_count = None;
    bench.world.board.faults.ascii_torn = true;
    bench.write(0x06D0, 0);
    while bench.read(0x06D0) == 0 {
        bench.run(1);
    }
    // Of "3713707" only two characters have come; "16" is left of "1.16D".
    let words = |bench: &Bench| [0x06D4, 0x06D6].map(|offset| bench.read(offset).to_le_bytes());
    assert_eq!(words(&bench), [*b"37", *b"16"]);
    bench.run(1);
    assert_eq!(words(&bench), [*b"37", *b"13"]);
    assert_eq!(bench.response(), line("3713707"));
}
