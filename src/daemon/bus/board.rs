//! The board of the settings, opened: a simulator's, a file, or a window of the machine's memory, and its interrupt.

use std::path::PathBuf;
use std::sync::Arc;

use log::{info, warn};

use crate::clock::Clock;
use crate::daemon::bus::ports::interrupt::InterruptLink;
use crate::daemon::config::settings::Settings;
use crate::daemon::service::simulator::Simulator;
use crate::device::interrupt::InterruptError;
use crate::device::uio::interrupt::NoInterrupt;
use crate::device::{
    self, Access, BoardSpec, Counted, FileBoard, Inherited, Interrupt, InterruptSource, OpenedBoard,
    OpenedReplay, ReplayBoard, System, Traced, WindowSpec, WordSwapped,
};
use crate::format::WordOrder;
use crate::recording::Replies;

/// The board's words, counted and traced.
pub type BoardBus = Counted<Traced<Box<dyn device::Board>>>;

/// Opens the board again after its memory was replaced or its device came back.
pub type OpenBus = Box<dyn FnMut() -> Result<OpenedBoard, OpenError> + Send>;

/// Names the part that the daemon cannot open, the reason and the remedy.
pub type OpenError = Box<dyn std::error::Error + Send + Sync>;

/// The board, and how to open it again.
pub struct Board {
    /// The daemon's own simulator, which ends with this value.
    pub simulator: Option<Simulator>,
    /// The board's words.
    pub bus: Box<dyn device::Board>,
    /// Opens the board again.
    pub open: OpenBus,
    /// The board's interrupt, if the board may have one.
    pub interrupt: Option<InterruptLink>,
    /// In a replay, the recording's replies.
    pub replies: Option<Arc<Replies>>,
}

/// Opens the board that `settings` name. Uses descriptors from the service manager before it opens nodes. A replay
/// plays in the time of `clock`.
///
/// # Errors
/// Names the part that the daemon cannot open, the reason and the remedy. A missing UIO interrupt is an error if the
/// settings name it. An interrupt that cannot be armed is no error: the daemon then polls for replies.
pub fn open(
    settings: &Settings,
    system: &System,
    inherited: &Inherited,
    clock: &Clock,
) -> Result<Board, OpenError> {
    let (order, dpram) = (settings.word_order, settings.family.length as usize);
    match &settings.board {
        BoardSpec::Simulator(spec) => {
            let simulator = Simulator::start(settings.family, settings.firmware.as_deref(), spec)?;
            let source = Some(simulator.interrupt());
            let open = open_file(simulator.memory(), dpram, order, Access::Bits16);
            Ok(Board { simulator: Some(simulator), ..of_file(open, source, system, inherited)? })
        }
        BoardSpec::File { path, interrupt, access } => {
            of_file(open_file(path.clone(), dpram, order, *access), interrupt.clone(), system, inherited)
        }
        BoardSpec::Replay { directory, .. } => {
            let opened = ReplayBoard::open(directory, settings.family, settings.text_order, clock.clone())?;
            let OpenedReplay { board, replies } = opened;
            // A replay never goes away.
            let open: OpenBus = Box::new(|| Err("a replay is not opened again".into()));
            Ok(Board { simulator: None, bus: Box::new(board), open, interrupt: None, replies: Some(replies) })
        }
        BoardSpec::Window(spec) => {
            let first = open_window(spec, dpram, order, system, inherited)?;
            let interrupt = match &spec.interrupt {
                Some(source) => Some(link(source.clone(), system, inherited)?),
                None => first.interrupt.map(|own| InterruptLink::of_board(usable(own))),
            };
            let (spec, system) = (spec.clone(), system.clone());
            let open: OpenBus =
                Box::new(move || open_window(&spec, dpram, order, &system, &Inherited::default()));
            Ok(Board { simulator: None, bus: first.bus, open, interrupt, replies: None })
        }
    }
}

/// Opens `bytes` of the board, only to look at them. Takes no interrupt.
///
/// # Errors
/// As [`open`].
pub fn open_to_look(
    settings: &Settings,
    bytes: usize,
    system: &System,
    inherited: &Inherited,
) -> Result<Box<dyn device::Board>, OpenError> {
    let order = settings.word_order;
    match &settings.board {
        BoardSpec::Simulator(_) => Err("a simulator is not looked at".into()),
        BoardSpec::Replay { .. } => Err("a replay is not looked at".into()),
        BoardSpec::File { path, .. } => Ok(open_file(path.clone(), bytes, order, Access::Bits16)()?.bus),
        BoardSpec::Window(spec) => Ok(open_window(spec, bytes, order, system, inherited)?.bus),
    }
}

fn of_file(
    mut open: OpenBus,
    source: Option<InterruptSource>,
    system: &System,
    inherited: &Inherited,
) -> Result<Board, OpenError> {
    let bus = open()?.bus;
    let interrupt = source.map(|source| link(source, system, inherited)).transpose()?;
    Ok(Board { simulator: None, bus, open, interrupt, replies: None })
}

fn open_file(path: PathBuf, dpram: usize, order: WordOrder, access: Access) -> OpenBus {
    Box::new(move || {
        let board = FileBoard::open(&path, dpram)?.with_access(access);
        Ok(OpenedBoard { bus: in_order(Box::new(board), order), interrupt: None })
    })
}

fn open_window(
    spec: &WindowSpec,
    dpram: usize,
    order: WordOrder,
    system: &System,
    inherited: &Inherited,
) -> Result<OpenedBoard, OpenError> {
    let opened = device::open(spec, dpram, system, inherited)?;
    Ok(OpenedBoard { bus: in_order(opened.bus, order), ..opened })
}

fn in_order(bus: Box<dyn device::Board>, order: WordOrder) -> Box<dyn device::Board> {
    match order {
        WordOrder::Little => bus,
        WordOrder::Swapped => Box::new(WordSwapped(bus)),
    }
}

/// A link to an interrupt from a `source` of its own. A simulator's socket may come later. A UIO device has to be there
/// now, while the daemon has the privilege to open it.
pub(in crate::daemon) fn link(
    source: InterruptSource,
    system: &System,
    inherited: &Inherited,
) -> Result<InterruptLink, OpenError> {
    if matches!(source, InterruptSource::Unix(_)) {
        return Ok(InterruptLink::new(source));
    }
    match Interrupt::open(&source, system, inherited) {
        Ok(interrupt) => Ok(InterruptLink::opened(source, interrupt)),
        Err(InterruptError::None(reason @ NoInterrupt::Rearm { .. })) => {
            Ok(InterruptLink::of_board(usable(Err(reason))))
        }
        Err(error) => Err(format!("irq={source}: {error}").into()),
    }
}

/// The interrupt; `None`, with an entry in the log, if the daemon cannot use it.
pub fn usable(interrupt: Result<Interrupt, NoInterrupt>) -> Option<Interrupt> {
    match interrupt {
        Ok(interrupt) => Some(interrupt),
        Err(reason @ NoInterrupt::NoLine(_)) => {
            info!("{reason}; responses are looked for instead");
            None
        }
        Err(reason) => {
            warn!("{reason}; responses are looked for instead");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::options::Options;
    use crate::device::Bus;

    fn settings(board: &str) -> Settings {
        let options = Options { board: Some(board.to_owned()), ..Options::default() };
        Settings::decide(&options).unwrap()
    }

    #[test]
    fn a_window_is_opened_again_when_its_device_came_back() {
        let root = tempfile::tempdir().unwrap();
        let system = System::below(root.path());
        let memory = root.path().join("dev/mem");
        std::fs::create_dir_all(memory.parent().unwrap()).unwrap();
        std::fs::write(&memory, vec![0; 0x8000]).unwrap();
        let mut board =
            open(&settings("mem:0x4000"), &system, &Inherited::default(), &Clock::real()).unwrap();
        assert!(board.interrupt.is_none());
        board.bus.write16(crate::map::HostOffset::new(0), 0x1234).unwrap();
        assert_eq!(std::fs::read(&memory).unwrap()[0x4000..0x4002], [0x34, 0x12]);
        let mut again = (board.open)().unwrap();
        assert_eq!(again.bus.read16(crate::map::HostOffset::new(0)).unwrap(), 0x1234);
        std::fs::remove_file(&memory).unwrap();
        assert!((board.open)().err().unwrap().to_string().contains("mem:0x4000"));
    }

    #[test]
    fn an_interrupt_that_was_asked_for_and_is_not_there_is_an_error() {
        let root = tempfile::tempdir().unwrap();
        let system = System::below(root.path());
        std::fs::create_dir_all(root.path().join("dev")).unwrap();
        std::fs::write(root.path().join("dev/mem"), vec![0; 0x4000]).unwrap();
        let error =
            open(&settings("mem:0,irq=uio:/dev/uio7"), &system, &Inherited::default(), &Clock::real())
                .err()
                .unwrap();
        let error = error.to_string();
        assert!(error.contains("irq=uio:/dev/uio7") & error.contains("no UIO device is there"), "{error}");
        let board =
            open(&settings("mem:0,irq=unix:/nonexistent"), &system, &Inherited::default(), &Clock::real())
                .unwrap();
        assert!(!board.interrupt.unwrap().is_connected(), "a simulator may come later");
    }
}
