//! A simulated board, its daemon and a gateway, as processes. Dropping it ends them all.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
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

/// A board, its daemon and a gateway.
pub struct Site {
    directory: tempfile::TempDir,
    name: String,
    simulator: Child,
    daemon: Child,
    gateway: Child,
    address: SocketAddr,
}

impl Site {
    /// A classic board, and a gateway with these options.
    pub fn new(gateway: &[&str]) -> Self {
        Self::of("pmac", gateway)
    }

    /// A board of this family.
    pub fn of(family: &str, gateway: &[&str]) -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let directory = tempfile::tempdir_in(pmac_dpram::segment::DIRECTORY).unwrap();
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("pmac-gateway-{}-{number}", std::process::id());
        let path = |file: &str| directory.path().join(file).display().to_string();
        let start = |program: &str, arguments: &[&str]| {
            let log = File::create(path(&format!("{program}.log"))).unwrap();
            let mut command = Command::new(programs().join(program));
            command.args(arguments).stdin(Stdio::null()).stderr(log).spawn().unwrap()
        };
        let interrupt = format!("unix:{}", path("irq"));
        let memory = path("dpram");
        let options = ["--memory", &memory, "--interrupt", &interrupt, "--dpram-startup", "--family", family];
        let simulator = start("pmac-sim", &options);
        wait_until("the simulator", || directory.path().join("irq").exists());
        let board = format!("file:{memory},irq={interrupt}");
        let socket = path("socket");
        let config = path("config");
        std::fs::write(&config, format!("family = \"{family}\"\n")).unwrap();
        let options = ["--config", &config, "--board", &board, "--name", &name, "--socket", &socket];
        let daemon = start("pmacd", &options);
        wait_until("the daemon", || UnixStream::connect(&socket).is_ok());
        let options = ["--socket", &socket, "--name", &name, "--listen", "127.0.0.1:0"];
        let gateway = start("pmac-gateway", &[&options, gateway].concat());
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

    /// A connection to the daemon, beside the gateway.
    pub fn connection(&self) -> Connection {
        Connection::open(&self.directory.path().join("socket")).unwrap()
    }

    /// The answer of the board itself, beside the gateway.
    pub fn ask(&self, line: &str) -> Vec<String> {
        self.connection().send(line, PATIENCE).unwrap()
    }

    /// What a program has logged.
    pub fn log(&self, program: &str) -> String {
        std::fs::read_to_string(self.directory.path().join(format!("{program}.log"))).unwrap_or_default()
    }

    /// A client.
    pub fn client(&self) -> Client {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Client { stream }
    }
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
