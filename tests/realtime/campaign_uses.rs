//! What a host is about during the fault campaign. What is read back must be what was written, unless the board's misbehaviour
//! may have hidden or garbled it.

use std::time::{Duration, Instant};

use pmac_dpram::client::{Board, CommandError, Connection, RotaryFeed, RotaryLine, RotaryPlace};
use pmac_dpram::map::{
    BufferLayout, BufferSettings, Family, Function, Generation, HostOffset, Layout, VariableName,
};
use pmac_dpram::protocol::CallError;
use pmac_dpram::protocol::board::VariableRecord;
use pmac_dpram::segment::RegionId;

use crate::misbehaviour::{Misbehaviour, garbles};
use crate::support::{Site, wait_until};

/// What a sender gives the board: a line of which the reply ends by silence takes 100 ms longer.
pub const TIMEOUT: Duration = Duration::from_millis(750);
/// What a board does in the background comes within this, or is not waited for any longer.
const BACKGROUND: Duration = Duration::from_secs(5);

/// Registers that nobody else writes, of boards of a generation.
struct Registers {
    /// [`Use::Variables`] sets and watches it.
    watched: &'static str,
    /// It is watched beside that one.
    beside: &'static str,
}

const PMAC: Registers = Registers { watched: "Y:$0740", beside: "D:$0028" };
/// Above the motors' registers, which end at $107F, and below the coordinate systems', which begin at $2000 (Turbo Software
/// Reference p. 284-290).
const TURBO: Registers = Registers { watched: "Y:$1240", beside: "D:$00008B" };
/// Where [`Use::SetVariable`] writes, on PMAC.
const FIRST_SET: u64 = 0x750;
/// How many it writes: more than one table of the board's holds.
const SET: u64 = 40;

fn registers(family: &Family) -> &'static Registers {
    match family.generation {
        Generation::Pmac => &PMAC,
        Generation::Turbo => &TURBO,
    }
}

/// Words that [`Use::Words`] writes.
const WORDS: u16 = 16;

/// Where: the end of a stretch of the DPRAM that by default no function takes. It begins later where the firmware says where the
/// gather buffer is.
fn user_area(family: &'static Family) -> HostOffset {
    let plan = BufferLayout::new(&Layout::new(family, None), &BufferSettings::default());
    let end = plan.unwrap().user_regions().first().expect("room for the user").end;
    HostOffset::new(end.bytes() - 2 * u32::from(WORDS))
}

/// What the host is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Use {
    Count,
    Ask,
    Control,
    Panel,
    Feed,
    Variables,
    SetVariable,
    Words,
    Rotary,
    Gather,
}

const USES: &[Use] = &[
    Use::Count,
    Use::Ask,
    Use::Control,
    Use::Panel,
    Use::Feed,
    Use::Variables,
    Use::SetVariable,
    Use::Words,
    Use::Rotary,
    Use::Gather,
];

/// What a host can be about on a board of `family`.
pub fn uses(family: &Family) -> Vec<Use> {
    let is_used = |function| family.functions.contains(&function);
    let can_be = |used: &Use| match used {
        Use::Panel | Use::Feed => is_used(Function::Panel),
        Use::Rotary => is_used(Function::Rotary),
        Use::SetVariable => family.variable_write.since.is_some(),
        Use::Count | Use::Ask | Use::Control | Use::Variables | Use::Words | Use::Gather => true,
    };
    USES.iter().copied().filter(can_be).collect()
}

/// How often a variable of the board was asked to go up by one, and was told to have done so.
#[derive(Default)]
pub struct Count {
    pub asked: u64,
    pub done: u64,
}

impl Count {
    fn ask(&mut self, connection: &mut Connection) -> Result<(), CommandError> {
        self.asked += 1;
        connection.send("P100=P100+1", TIMEOUT)?;
        self.done += 1;
        Ok(())
    }

    pub fn begin(&mut self, connection: &mut Connection) {
        wait_until("P100 to be set", || connection.send("P100=0", Duration::from_secs(2)).is_ok());
        *self = Self::default();
    }
}

/// Whether a host that was told of no error must find what it has written, with the board misbehaving so.
fn keeps(misbehaviour: Misbehaviour, used: Use) -> bool {
    use Misbehaviour::{Fault, Power, Reset};
    // A memory that is not there, or is forgotten.
    if matches!(misbehaviour, Fault("all_ones" | "all_zeros", _) | Reset | Power) {
        return false;
    }
    // What the board itself says of a word before it is there, or of a record before it is executed.
    match used {
        Use::Words => true,
        Use::Variables => !garbles(misbehaviour) && misbehaviour != Fault("variable_read_torn", "on"),
        Use::SetVariable => !garbles(misbehaviour) && misbehaviour != Fault("variable_write_torn", "on"),
        Use::Rotary => !garbles(misbehaviour) && misbehaviour != Fault("rotary_torn", "on"),
        Use::Count | Use::Ask | Use::Control | Use::Panel | Use::Feed | Use::Gather => !garbles(misbehaviour),
    }
}

/// Uses a function once, in run `run` of a board of `family` that misbehaves so.
pub fn use_it(
    site: &Site,
    family: &'static Family,
    used: Use,
    count: &mut Count,
    run: u64,
    misbehaviour: Misbehaviour,
) -> Result<(), CommandError> {
    let keeps = keeps(misbehaviour, used);
    let mut connection = Connection::open(&site.socket())?;
    match used {
        Use::Count => (0..3).try_for_each(|_| count.ask(&mut connection)),
        Use::Ask => {
            // Another's reply would not have this number in it.
            let number = run % 1_000_000;
            let reply = connection.send(&format!("P101={number} P101"), TIMEOUT)?;
            assert!(garbles(misbehaviour) || reply == [number.to_string()], "{reply:?}");
            Ok(())
        }
        Use::Control => connection.control(0x04).map(drop),
        Use::Panel => {
            connection.panel("jog+", &[1, 3])?;
            connection.panel("jog-stop", &[1, 3])
        }
        Use::Feed => {
            connection.feed_override(1, Some(7253))?;
            connection.feed_override(1, None).map(drop)
        }
        Use::Variables => variables(site, registers(family), &mut connection, run, keeps),
        Use::SetVariable => set_variables(&mut connection, run, keeps),
        Use::Words => {
            let first = user_area(family);
            let words: Vec<u16> = (0..WORDS).map(|word| run as u16 ^ word).collect();
            let masked: Vec<(u16, u16)> = words.iter().map(|&word| (word, 0xFFFF)).collect();
            connection.write(first, &masked, false)?;
            let (_, found) = connection.read(first, WORDS.into())?;
            assert!(!keeps || found == words, "written {words:X?}, read {found:X?}");
            Ok(())
        }
        Use::Rotary => rotary(connection, run, keeps),
        Use::Gather => {
            let (status, _, error) =
                site.pmacctl(&["gather", "--source", "servo_timer", "--seconds", "0.05", "-o", "-"]);
            if status == 0 { Ok(()) } else { Err(CallError::Protocol(error).into()) }
        }
    }
}

/// Has a register set by a command, and copied by the board into the table of the background.
fn variables(
    site: &Site,
    &Registers { watched, beside, .. }: &Registers,
    connection: &mut Connection,
    run: u64,
    keeps: bool,
) -> Result<(), CommandError> {
    let value = (run % 0x80_0000) as u32;
    connection.send(&format!("W{},{value}", watched.replace(':', "")), TIMEOUT)?;
    let mut board = board(site)?;
    let gone = |error| CommandError::from(CallError::Protocol(format!("{error}")));
    // What was copied for somebody before is no answer.
    let mut seen = board.subscriber().published(RegionId::Variable).map_err(|error| gone(error.into()))?;
    let registers = ["X:$0000", beside, watched].map(|text| text.parse::<VariableName>().unwrap());
    let mut watch = board.watch_variables(&registers)?;
    let end = Instant::now() + BACKGROUND;
    loop {
        let is_news = board.wait_variables(seen, TIMEOUT).map_err(gone)?;
        watch.check()?;
        if is_news {
            seen = board.subscriber().published(RegionId::Variable).map_err(|error| gone(error.into()))?;
            let table = board.variables().map_err(gone)?;
            let copied = table.as_ref().and_then(|table| table.data.value_of(registers[2]));
            if let Some(copied) = copied {
                assert!(!keeps || copied.value() == [value], "{watched} was set to {value}: {copied:?}");
                return Ok(());
            }
        }
        if Instant::now() > end {
            return Err(CallError::Protocol("the board copies no variables".to_owned()).into());
        }
    }
}

/// Has the board write registers in the background, and asks it what they hold.
fn set_variables(connection: &mut Connection, run: u64, keeps: bool) -> Result<(), CommandError> {
    let count = SET;
    // Other values in each run: what the run before has left is not taken for what this one wrote.
    let value = |index: u64| (run * count + index) % 0x80_0000;
    let record = |index: u64| VariableRecord {
        register: format!("Y:${:04X}", FIRST_SET + index),
        offset: None,
        width: None,
        value: value(index) as f64,
    };
    let records: Vec<VariableRecord> = (0..count).map(record).collect();
    connection.write_variables(&records, TIMEOUT)?;
    for part in (0..count).step_by(8) {
        let line = format!("RY${:04X},8", FIRST_SET + part);
        let reply = connection.send(&line, TIMEOUT)?.join(" ");
        let expected: Vec<String> = (part..part + 8).map(|index| value(index).to_string()).collect();
        assert!(!keeps || reply == expected.join(" "), "{line}: {reply}, written {expected:?}");
    }
    Ok(())
}

/// Sets a rotary buffer up and has the board take one line, which it then has in its own.
fn rotary(mut connection: Connection, run: u64, keeps: bool) -> Result<(), CommandError> {
    for line in ["DELETE GATHER", "&1DELETE ROT"] {
        match connection.send(line, TIMEOUT) {
            // The first time there is none to delete.
            Err(CommandError::Refused(CallError::Board { .. })) if line.contains("DELETE ROT") => {}
            result => drop(result?),
        }
    }
    let place = RotaryPlace {
        buffer: 1,
        coordinate_system: 1,
        coordinate_system_base: 1,
        define_longs: Some(100),
        ..RotaryPlace::default()
    };
    connection.rotary_start(place)?;
    // X10, and in other runs X10 Y-5.
    let commands = [(0x00_0E23, 0x50_0000), (0x00_0661, 0x98_0000)];
    let lines: Vec<RotaryLine> = vec![commands[..1 + run as usize % 2].to_vec()];
    let mut feed = RotaryFeed::new(connection, 1, &lines);
    let end = Instant::now() + BACKGROUND;
    while !feed.is_done() {
        feed.step()?;
        if Instant::now() > end {
            return Err(CallError::Protocol("the line does not go into the buffer".to_owned()).into());
        }
    }
    feed.finish()?;
    loop {
        let state = feed.state()?;
        assert_eq!(state.sent_lines, 1, "{state:?}");
        if state.ahead_lines == 0 {
            break;
        }
        if Instant::now() > end {
            return Err(CallError::Protocol("the board does not take the line".to_owned()).into());
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let stop = feed.stop()?;
    match stop.left_lines {
        // A board that listens no more cannot be asked: then the end says so.
        None if !stop.notes.is_empty() => Err(CallError::Protocol(stop.notes.join(" ")).into()),
        left => {
            assert!(!keeps || left == Some(1), "a line was taken, and the board has {stop:?}");
            Ok(())
        }
    }
}

fn board(site: &Site) -> Result<Board, CommandError> {
    let gone = |_| CallError::Protocol("no segment".to_owned()).into();
    Board::attach(&site.name).map(|board| board.with_socket(&site.socket())).map_err(gone)
}
