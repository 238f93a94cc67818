//! Recordings of a board in virtual time, and what its mirror showed meanwhile.

use std::path::{Path, PathBuf};
use std::time::Duration;

use pmac_dpram::map::HostOffset;
use pmac_dpram::recording::{About, Access, Answer, FORMAT, Op, Writer};
use pmac_dpram::segment::{RegionId, Sample};

use super::{PATIENCE, VirtualSite};

/// Everything that was published of the servo report from sequence number `from` on: the words of each update.
pub fn updates(site: &VirtualSite, from: u64) -> Vec<Vec<u16>> {
    let reader = site.attach();
    let mut cursor = reader.cursor(RegionId::Servo, from).unwrap();
    let mut sample = Sample::new();
    let mut all = Vec::new();
    while reader.next(&mut cursor, &mut sample).unwrap() {
        all.push(sample.words().to_vec());
    }
    assert_eq!(cursor.lost(), 0);
    all
}

/// How many updates of the servo report were published.
pub fn published(site: &VirtualSite) -> u64 {
    site.attach().published(RegionId::Servo).unwrap()
}

/// The lines `I10=5` that a reply to a question like `I0..99` comes to.
fn values(answer: &Answer) -> Vec<String> {
    let first = answer.line.strip_prefix('I').and_then(|line| line.split("..").next()?.parse::<u16>().ok());
    let numbered = first.into_iter().flat_map(|first| (first..).zip(&answer.reply));
    numbered.map(|(number, value)| format!("I{number}={value}\n")).collect()
}

/// Records the board for `time`, with the answers to `lines`, and gives the directory and the updates of that time.
pub fn record(site: &VirtualSite, lines: &[&str], time: Duration) -> (PathBuf, Vec<Vec<u16>>) {
    let directory = site.path("recording");
    let mut connection = site.connection();
    let answer = |line: &&str| Answer {
        line: (*line).to_owned(),
        reply: match pmac_dpram::protocol::control::parse(line) {
            Some(character) => site.connection().control(character).unwrap(),
            None => site.connection().send(line, PATIENCE).unwrap(),
        },
        refused: None,
    };
    let answers: Vec<Answer> = lines.iter().map(answer).collect();
    site.hold();
    let (info, settings) = (connection.info().unwrap(), connection.settings().unwrap());
    let family = pmac_dpram::map::Family::by_name(&info.family).unwrap();
    let time_ns = site.with_world(|world| world.now_ns());
    let bytes = std::fs::read(site.path("dpram")).unwrap();
    let words: Vec<u16> = bytes.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect();
    let about = About {
        format: FORMAT,
        program: "pmacctl".into(),
        pmacd: info.version,
        taken: "2026-11-25T12:00:00Z".into(),
        began_ns: time_ns,
        name: info.name,
        board: "file".into(),
        family: info.family,
        board_type: info.board_type,
        firmware: info.firmware,
        dpram_bytes: family.length,
        servo_period_ns: info.servo_period_ns,
        settings,
        updates: 0,
        accesses: 0,
        dropped: 0,
        cut_short: None,
        left_out: Vec::new(),
    };
    let mut writer = Writer::create(Path::new(&directory), &about).unwrap();
    writer.image(time_ns, &words).unwrap();
    answers.iter().for_each(|answer| writer.answer(answer).unwrap());
    let variables: String = answers.iter().flat_map(values).collect();
    writer.variables(&variables).unwrap();
    connection.trace(false).unwrap();
    let before = published(site);
    let mut fetch = |end| {
        let mut t_ns = 0;
        let reply = connection.trace(end).unwrap();
        assert_eq!(reply.dropped, 0);
        for access in reply.accesses.chunks(4) {
            t_ns += access[0];
            let (op, width) = match access[1] {
                0 => (Op::Read, 16),
                1 => (Op::Write, 16),
                _ => (Op::Read, 32),
            };
            let offset = HostOffset::new(access[2] as u32);
            writer.access(&Access { t_ns, op, offset, width, value: access[3] as u32 }).unwrap();
        }
        reply.accesses.is_empty()
    };
    let slices = time.as_millis() / 20;
    for _ in 0..slices {
        site.run_for(Duration::from_millis(20));
        while !fetch(false) {}
    }
    fetch(true);
    while !fetch(true) {}
    let shown = updates(site, before + 1);
    site.go_on();
    writer.finish(about).unwrap();
    (directory, shown)
}
