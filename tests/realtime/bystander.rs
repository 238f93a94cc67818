//! Clients that die in the middle of what they do: processes of their own, ended by SIGKILL.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};

use pmac_dpram::map::{Family, Function};

use crate::support::Site;

/// What somebody else is at who will not live to end it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Bystander {
    /// Woken at each servo update.
    Subscribed,
    /// Holds registers that the board copies for it.
    Watching,
    /// Holds a jog button down.
    Jogging,
    /// Fills a rotary buffer.
    Streaming,
    /// Takes gathered samples.
    Gathering,
    /// Has sent half a message.
    HalfSaid,
}

/// The motor that [`Bystander::Jogging`] moves.
pub const JOGGED: u32 = 4;

impl Bystander {
    const ALL: &'static [Self] =
        &[Self::Subscribed, Self::Watching, Self::Jogging, Self::Streaming, Self::Gathering, Self::HalfSaid];

    /// Those who use what boards of `family` have.
    pub fn on(family: &Family) -> Vec<Self> {
        let needs = |bystander: &Self| match bystander {
            Self::Jogging => Some(Function::Panel),
            Self::Streaming => Some(Function::Rotary),
            Self::Subscribed | Self::Watching | Self::Gathering | Self::HalfSaid => None,
        };
        let is_there =
            |bystander: &Self| needs(bystander).is_none_or(|function| family.functions.contains(&function));
        Self::ALL.iter().copied().filter(is_there).collect()
    }

    /// Whether everybody else is served all the same: there is one gather, one rotary buffer, one table of registers.
    pub fn leaves_room(self) -> bool {
        matches!(self, Self::Subscribed | Self::Jogging | Self::HalfSaid)
    }

    /// Begins. `site` must have been [`prepared`](prepare).
    pub fn start(self, site: &Site) -> Running {
        let program = site.path("bystander.pmc");
        let arguments: &[&str] = match self {
            Self::Subscribed => &["watch", "--rate", "1000"],
            Self::Watching => &["variable", "watch", "X:$0000", "Y:$1202"],
            Self::Jogging => &["panel", "jog+", "4", "--hold"],
            Self::Streaming => &["rotary", "stream", program.to_str().unwrap(), "--define", "200"],
            Self::Gathering => &["gather", "--source", "servo_timer", "-o", "-"],
            Self::HalfSaid => {
                let mut stream = UnixStream::connect(site.socket()).ok();
                if let Some(stream) = &mut stream {
                    let _ = stream.write_all(br#"{"method":"io.github.pmac-dpram.Board.Send","para"#);
                }
                return Running { process: None, _stream: stream };
            }
        };
        let mut command = Command::new(env!("CARGO_BIN_EXE_pmacctl"));
        command.args(["--name", &site.name]).arg("--socket").arg(site.socket()).args(arguments);
        // An input that ends would let the button go.
        let quiet = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        Running { process: Some(quiet.spawn().unwrap()), _stream: None }
    }
}

/// Writes what the bystanders need.
pub fn prepare(site: &Site) {
    let text: String = (0..500).map(|line| format!("X{line} Y{}\n", line * 7 % 50)).collect();
    std::fs::write(site.path("bystander.pmc"), text).unwrap();
}

/// One that is at it. Dropped, it is dead.
pub struct Running {
    process: Option<Child>,
    _stream: Option<UnixStream>,
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(process) = &mut self.process {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}
