//! A simulated board, its daemon and a gateway, as processes. Dropping it ends them all.

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use pmac_dpram::client::Connection;

/// How long anything may take.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// The directory of the programs. Those of the package above are built before: `cargo build --bins`.
fn programs() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_pmac-gateway")).parent().unwrap().to_owned()
}

/// Waits until `done`.
pub fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !done() {
        assert!(Instant::now() < end, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What is started, and how.
#[derive(Clone, Copy)]
pub struct Setup<'a> {
    pub family: &'a str,
    /// More of the daemon's configuration.
    pub config: &'a str,
    /// Options of the gateway, and of the simulator.
    pub gateway: &'a [&'a str],
    pub simulator: &'a [&'a str],
}

impl Default for Setup<'_> {
    fn default() -> Self {
        Self { family: "pmac", config: "", gateway: &[], simulator: &[] }
    }
}

/// A board, its daemon and a gateway.
pub struct Site {
    directory: tempfile::TempDir,
    name: String,
    simulator: Child,
    daemon: Child,
    gateway: Child,
    address: SocketAddr,
}

/// The command of a program.
fn program(name: &str) -> Command {
    let mut command = Command::new(programs().join(name));
    command.stdin(Stdio::null());
    command
}

impl Site {
    /// A classic board, and a gateway with these options.
    pub fn new(gateway: &[&str]) -> Self {
        Self::set_up(Setup { gateway, ..Setup::default() })
    }

    /// A board of this family.
    pub fn of(family: &str, gateway: &[&str]) -> Self {
        Self::set_up(Setup { family, gateway, ..Setup::default() })
    }

    /// What `setup` says.
    pub fn set_up(setup: Setup<'_>) -> Self {
        let Setup { family, config: more, gateway, simulator: own } = setup;
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let directory = tempfile::tempdir_in(pmac_dpram::segment::DIRECTORY).unwrap();
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("pmac-gateway-{}-{number}", std::process::id());
        let path = |file: &str| directory.path().join(file).display().to_string();
        let log = |program: &str| File::create(path(&format!("{program}.log"))).unwrap();
        let interrupt = format!("unix:{}", path("irq"));
        let memory = path("dpram");
        let control = format!("unix:{}", path("control"));
        let options = ["--memory", &memory, "--interrupt", &interrupt, "--control", &control];
        let own = &[&["--dpram-startup", "--family", family], own].concat();
        let simulator = program("pmac-sim").args(options).args(own).stderr(log("pmac-sim")).spawn().unwrap();
        wait_until("the simulator", || directory.path().join("irq").exists());
        let config = format!("board = \"file:{memory},irq={interrupt}\"\nfamily = \"{family}\"\n{more}");
        std::fs::write(path("config"), config).unwrap();
        let daemon = daemon(directory.path(), &name);
        wait_until("the daemon", || UnixStream::connect(path("socket")).is_ok());
        let mut command = gateway_command(directory.path(), &name, gateway);
        let gateway = command.stderr(log("pmac-gateway")).spawn().unwrap();
        let mut site =
            Self { directory, name, simulator, daemon, gateway, address: "127.0.0.1:0".parse().unwrap() };
        wait_until("the gateway", || {
            let log = site.log("pmac-gateway");
            let line = log.lines().find_map(|line| line.split_once("listening on "));
            line.map(|(_, address)| site.address = address.parse().unwrap()).is_some()
        });
        wait_until("the board", || site.connection().send("I3", PATIENCE).is_ok());
        site
    }

    /// Ends the daemon, and waits until it has ended.
    pub fn stop_daemon(&mut self) {
        self.daemon.kill().unwrap();
        self.daemon.wait().unwrap();
    }

    /// Starts the daemon again, and waits until the board answers.
    pub fn start_daemon(&mut self) {
        self.daemon = daemon(self.directory.path(), &self.name);
        wait_until("the daemon", || UnixStream::connect(self.directory.path().join("socket")).is_ok());
        wait_until("the board", || self.connection().send("I3", PATIENCE).is_ok());
    }

    /// The command of another gateway to the same board.
    pub fn another_gateway(&self, options: &[&str]) -> Command {
        gateway_command(self.directory.path(), &self.name, options)
    }

    /// Process number of the gateway.
    pub fn gateway_pid(&self) -> u32 {
        self.gateway.id()
    }

    /// The place of board and socket.
    pub fn directory(&self) -> &Path {
        self.directory.path()
    }

    /// The board's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A client by UDP.
    pub fn udp(&self) -> UdpSocket {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(self.address).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        socket
    }

    /// A connection to the daemon, beside the gateway.
    pub fn connection(&self) -> Connection {
        Connection::open(&self.directory.path().join("socket")).unwrap()
    }

    /// The answer of the board itself, beside the gateway.
    pub fn ask(&self, line: &str) -> Vec<String> {
        self.connection().send(line, PATIENCE).unwrap()
    }

    /// Has the simulator do something: a line of its control socket.
    pub fn simulate(&self, line: &str) {
        let mut control = BufReader::new(UnixStream::connect(self.directory.path().join("control")).unwrap());
        control.get_mut().write_all(format!("{line}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        control.read_line(&mut answer).unwrap();
        assert_eq!(answer.trim(), "ok", "{line}");
    }

    /// What a program has logged.
    pub fn log(&self, program: &str) -> String {
        std::fs::read_to_string(self.directory.path().join(format!("{program}.log"))).unwrap_or_default()
    }

    /// A client.
    pub fn client(&self) -> Client {
        Client::of(self.address)
    }
}

/// Starts a daemon. Its log goes on where another's ended.
fn daemon(directory: &Path, name: &str) -> Child {
    let log = File::options().create(true).append(true).open(directory.join("pmacd.log")).unwrap();
    let mut command = program("pmacd");
    command.arg("--config").arg(directory.join("config")).arg("--socket").arg(directory.join("socket"));
    command.args(["--name", name]).stderr(log).spawn().unwrap()
}

/// The command of a gateway.
fn gateway_command(directory: &Path, name: &str, options: &[&str]) -> Command {
    let mut command = program("pmac-gateway");
    command.arg("--socket").arg(directory.join("socket"));
    command.args(["--name", name, "--listen", "127.0.0.1:0"]).args(options);
    command
}

/// A client of a gateway whose log is a pipe, once it listens, and the log, of which nobody reads more.
pub fn listening(gateway: &mut Child) -> (Client, BufReader<ChildStderr>) {
    let mut log = BufReader::new(gateway.stderr.take().unwrap());
    loop {
        let mut line = String::new();
        assert_ne!(log.read_line(&mut line).unwrap(), 0, "it has ended");
        if let Some((_, address)) = line.trim().split_once("listening on ") {
            return (Client::of(address.parse().unwrap()), log);
        }
    }
}

/// The answer to a line by GETRESPONSE in a datagram, as text.
pub fn datagram(socket: &UdpSocket, line: &str) -> String {
    socket.send(&get_response(line)).unwrap();
    let mut answer = [0; 2048];
    let count = socket.recv(&mut answer).unwrap();
    String::from_utf8(answer[..count].to_vec()).unwrap()
}

impl Drop for Site {
    fn drop(&mut self) {
        if std::thread::panicking() {
            for program in ["pmac-gateway", "pmacd"] {
                eprintln!("what {program} had logged:\n{}", self.log(program));
            }
        }
        for child in [&mut self.gateway, &mut self.daemon, &mut self.simulator] {
            let _ = child.kill();
            let _ = child.wait();
        }
        let _ = std::fs::remove_file(Path::new(pmac_dpram::segment::DIRECTORY).join(&self.name));
    }
}

/// The bytes of a request.
pub fn packet(kind: u8, request: u8, value: u16, index: u16, length: u16, data: &[u8]) -> Vec<u8> {
    let numbers = [value, index, length].map(u16::to_be_bytes);
    [&[kind, request], numbers.as_flattened(), data].concat()
}

/// A line as GETRESPONSE.
pub fn get_response(line: &str) -> Vec<u8> {
    packet(0x40, 0xBF, 0, 0, u16::try_from(line.len()).unwrap(), line.as_bytes())
}

/// A client by TCP, as simple as the known ones.
pub struct Client {
    pub stream: TcpStream,
}

impl Client {
    /// A client of the gateway at `address`.
    pub fn of(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Self { stream }
    }

    /// Sends bytes, and takes whatever comes first for the answer.
    pub fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.stream.write_all(bytes).unwrap();
        self.answer()
    }

    /// What comes first; nothing when the gateway has ended the connection.
    pub fn answer(&mut self) -> Vec<u8> {
        let mut answer = [0; 2048];
        match self.stream.read(&mut answer) {
            Ok(count) => answer[..count].to_vec(),
            Err(error) if error.kind() == ErrorKind::ConnectionReset => Vec::new(),
            Err(error) => panic!("no answer: {error}"),
        }
    }

    /// The answer to a line by GETRESPONSE, as text.
    pub fn line(&mut self, line: &str) -> String {
        String::from_utf8(self.ask(&get_response(line))).unwrap()
    }

    /// The answer to a request without data.
    pub fn request(&mut self, kind: u8, request: u8, value: u16, length: u16) -> Vec<u8> {
        self.ask(&packet(kind, request, value, 0, length, &[]))
    }

    /// The answer to GETBUFFER.
    pub fn get_buffer(&mut self) -> Vec<u8> {
        self.request(0xC0, 0xC5, 0, 0)
    }

    /// Whether the gateway has ended the connection.
    pub fn is_ended(&mut self) -> bool {
        self.answer().is_empty()
    }
}
