//! The command socket: the protocol by an independent client, and what it must withstand.

use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use pmac_dpram::client::command::{CommandError, Connection};
use pmac_dpram::daemon::shared::info::Info;
use pmac_dpram::daemon::shared::queue::at_once;
use pmac_dpram::daemon::shared::status::BoardStatus;
use pmac_dpram::map::{HostOffset, PMAC};
use pmac_dpram::protocol::{
    BOARD, BOARD_DESCRIPTION, BoardInfo, BoardSettings, CallError, MessageKind, SERVICE_DESCRIPTION, State,
};
use proptest::prelude::*;
use serde_json::{Value, json};
use varlink::OrgVarlinkServiceInterface;
use varlink_parser::{IDL, VStruct, VStructOrEnum, VType, VTypeExt};

use crate::support::PATIENCE;
use crate::support::bench::{Bench, RELEASE, no_socket};
use crate::support::raw::{Raw, call, error_name};

fn connect(bench: &Bench) -> Connection {
    Connection::open(&bench.socket).unwrap()
}

fn refused(result: Result<Vec<String>, CommandError>) -> CallError {
    match result {
        Err(CommandError::Refused(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_independent_client_finds_its_way() {
    let bench = Bench::new();
    let address = format!("unix:{}", bench.socket.display());
    let connection = varlink::Connection::with_address(&address).unwrap();
    let mut service = varlink::OrgVarlinkServiceClient::new(connection.clone());
    let info = service.get_info().unwrap();
    assert_eq!(info.product, "pmacd");
    assert_eq!(info.interfaces, ["org.varlink.service", BOARD]);
    let description = service.get_interface_description(BOARD).unwrap().description.unwrap();
    assert_eq!(description, BOARD_DESCRIPTION);
    assert!(service.get_interface_description("no.such.interface").is_err());

    let mut call = varlink::MethodCall::<Value, Value, varlink::Error>::new(
        connection.clone(),
        format!("{BOARD}.Send"),
        json!({"line": "1,2"}),
    );
    assert_eq!(call.call().unwrap(), json!({"lines": ["1", "2"]}));
    let mut call = varlink::MethodCall::<Value, Value, varlink::Error>::new(
        connection,
        format!("{BOARD}.Send"),
        json!({"line": "BAD"}),
    );
    let error = call.call().unwrap_err();
    assert!(format!("{error:?}").contains("BoardError"), "{error:?}");
}

/// Whether the service knows the method at all.
fn understood(method: &str) -> bool {
    let bench = Bench::new();
    let mut client = Raw::new(&bench);
    client.call(method, json!({"no such parameter": 1}));
    error_name(&client.receive().unwrap()) != "MethodNotFound"
}

#[test]
fn an_independent_parser_reads_the_interfaces() {
    let service = IDL::try_from(SERVICE_DESCRIPTION).unwrap();
    assert_eq!(service.method_keys, ["GetInfo", "GetInterfaceDescription"]);
    let board = IDL::try_from(BOARD_DESCRIPTION).unwrap();
    assert_eq!(board.name, BOARD);
    let described: Vec<String> = board.method_keys.iter().map(|name| (*name).to_owned()).collect();
    for name in &described {
        assert!(understood(name), "{name} is described and not understood");
    }
    assert!(described.len() >= 16 && !understood("Nothing"));
    // Every error that the service can answer is declared, and the other way round.
    let mut errors = board.error_keys.clone();
    errors.sort_unstable();
    let declared = [
        "BoardError",
        "Busy",
        "Interrupted",
        "InvalidLine",
        "NotPermitted",
        "OutOfRange",
        "Refused",
        "StopFailed",
        "TimedOut",
        "Unavailable",
    ];
    assert_eq!(errors, declared);
    // What GetInfo answers is what it declares.
    let bench = Bench::new();
    let mut raw = Raw::new(&bench);
    raw.call("GetInfo", json!({}));
    let reply = raw.receive().unwrap();
    is_as_declared(&reply["parameters"], &board.methods["GetInfo"].output, &board);
}

/// Every field of the object, and of those inside, is declared, and every declared one is there unless it may be absent.
fn is_as_declared(answered: &Value, declared: &VStruct, interface: &IDL) {
    let answered = answered.as_object().unwrap();
    for name in answered.keys() {
        assert!(declared.elts.iter().any(|field| field.name == name), "{name} is not declared");
    }
    for field in &declared.elts {
        match (answered.get(field.name), &field.vtype) {
            (None, VTypeExt::Option(_)) => (),
            (None, _) => panic!("{} is declared and not answered", field.name),
            (Some(inner), VTypeExt::Plain(VType::Typename(name))) => {
                if let VStructOrEnum::VStruct(inner_type) = &interface.typedefs[name].elt {
                    is_as_declared(inner, inner_type, interface);
                }
            }
            _ => (),
        }
    }
}

#[test]
fn the_client_asks_and_hears() {
    let bench = Bench::new();
    let mut board = connect(&bench);
    let info = board.info().unwrap();
    assert_eq!((info.name.as_str(), info.motors, info.state), ("pmac0", 8, State::Live));
    assert_eq!(info.firmware.as_deref(), Some("1.16D"));
    assert_eq!(info.enabled, ["servo", "ascii"]);
    bench.report(BoardStatus { state: State::Stale, ..Bench::live() });
    assert_eq!(board.info().unwrap().state, State::Stale);

    assert_eq!(board.send("a,b,c", PATIENCE).unwrap(), ["a", "b", "c"]);
    assert!(board.send("J+", PATIENCE).unwrap().is_empty());
    assert!(board.control(0x0B).unwrap().is_empty());
    assert_eq!(board.read(HostOffset::new(0x24), 3).unwrap(), (7, vec![0x12, 0x13, 0x14]));
    assert_eq!(*bench.seen.lock().unwrap(), ["a,b,c", "J+", "^K", "read 0x0024 3"]);

    let error = refused(board.send("BAD", PATIENCE));
    assert_eq!(error.to_string(), "ERR003: data error or unrecognized command");
    assert!(matches!(error, CallError::Board { code: 3, lines, .. } if lines == ["before"]));
    assert_eq!(refused(board.send("LATE", PATIENCE)), CallError::TimedOut { lines: Vec::new() });
    assert!(matches!(refused(board.send("OFF", PATIENCE)), CallError::Unavailable { .. }));
    assert!(matches!(
        board.read(HostOffset::new(0x3FFE), 2),
        Err(CommandError::Refused(CallError::OutOfRange))
    ));
    assert_eq!(board.send("LONG", PATIENCE).unwrap().len(), 2000);
}

#[test]
fn an_invalid_line_never_reaches_the_bus_thread() {
    let bench = Bench::new();
    let mut board = connect(&bench);
    for line in ["", "#1\r#2", "\u{b}", "a\0b", "ü", &"x".repeat(201)] {
        assert!(matches!(refused(board.send(line, PATIENCE)), CallError::InvalidLine { .. }), "{line:?}");
    }
    assert_eq!(board.send(&"x".repeat(200), PATIENCE).unwrap(), ["x".repeat(200)]);
    assert_eq!(bench.seen.lock().unwrap().len(), 1);
}

#[test]
fn a_silent_bus_thread_ends_in_a_time_out() {
    // What came of a reply without its end is told, though nothing woke anybody.
    std::thread::scope(|scope| {
        for (line, lines) in [("SILENT", vec![]), ("HALF", vec!["half".to_owned()])] {
            scope.spawn(move || {
                let bench = Bench::new();
                let mut board = connect(&bench);
                let timed_out = CallError::TimedOut { lines };
                assert_eq!(refused(board.send(line, Duration::from_millis(50))), timed_out);
                assert_eq!(board.send("still there", PATIENCE).unwrap(), ["still there"]);
            });
        }
    });
}

#[test]
fn interleaved_clients_get_their_own_replies() {
    let bench = Bench::new();
    let mut clients = [(); at_once::LINES].map(|()| Raw::new(&bench));
    for (number, client) in clients.iter_mut().enumerate() {
        client.call("Send", json!({"line": format!("HOLD{number}")}));
        bench.wait_seen(&format!("HOLD{number}"));
    }
    connect(&bench).control(RELEASE).unwrap();
    for (number, client) in clients.iter_mut().enumerate() {
        let reply = client.receive().unwrap();
        assert_eq!(reply, json!({"parameters": {"lines": ["first of two", format!("HOLD{number}")]}}));
    }
}

#[test]
fn too_many_commands_are_busy_and_nothing_waits() {
    let bench = Bench::new();
    // The bus thread takes commands at once, so the queue is filled past it, by a server whose queue nobody empties.
    let (commands, _nobody) = pmac_dpram::daemon::shared::queue::queue(1).unwrap();
    let (_events, events) = pmac_dpram::daemon::shared::queue::queue(1).unwrap();
    let path = bench.socket.with_file_name("other.sock");
    let options = pmac_dpram::daemon::socket::options::ServeOptions::new(path.clone());
    let info = Info::new(&PMAC, BoardInfo::default(), BoardSettings::default());
    let backend = pmac_dpram::daemon::socket::server::Backend {
        commands,
        events,
        info,
        trace: pmac_dpram::device::Trace::new(0),
    };
    let _server =
        pmac_dpram::daemon::socket::server::serve(&options, options.listen().unwrap(), backend).unwrap();
    let mut first = UnixStream::connect(&path).unwrap();
    first.write_all(&call("Send", json!({"line": "1"}))).unwrap();
    let mut second = Connection::open(&path).unwrap();
    // The first one's command may not have been taken in yet; then this one times out, and the next finds it full.
    let short = Duration::from_millis(20);
    let errors = [refused(second.send("2", short)), refused(second.send("3", short))];
    assert!(errors.contains(&CallError::Busy), "{errors:?}");
    assert!(second.info().is_ok());
}

#[test]
fn pipelined_calls_are_answered_in_order_and_oneway_calls_not_at_all() {
    let bench = Bench::new();
    let mut raw = Raw::new(&bench);
    let mut all = call("Send", json!({"line": "1"}));
    let oneway = json!({"method": format!("{BOARD}.Send"), "parameters": {"line": "2"}, "oneway": true});
    all.extend_from_slice(oneway.to_string().as_bytes());
    all.push(0);
    let refused_oneway = json!({"method": format!("{BOARD}.Nothing"), "oneway": true});
    all.extend_from_slice(refused_oneway.to_string().as_bytes());
    all.push(0);
    all.extend_from_slice(&call("Nothing", json!({})));
    all.extend_from_slice(&call("SendControl", json!({"character": "^A"})));
    all.extend_from_slice(&call("Read", json!({"host_offset": 2, "words": 1})));
    all.extend_from_slice(&call("Send", json!({"line": "3"})));
    raw.send(&all);
    raw.stream.shutdown(Shutdown::Write).unwrap();
    assert_eq!(raw.receive().unwrap(), json!({"parameters": {"lines": ["1"]}}));
    assert_eq!(error_name(&raw.receive().unwrap()), "MethodNotFound");
    assert_eq!(raw.receive().unwrap(), json!({"parameters": {"lines": []}}));
    assert_eq!(raw.receive().unwrap(), json!({"parameters": {"time_ns": 7, "words": [1]}}));
    assert_eq!(raw.receive().unwrap(), json!({"parameters": {"lines": ["3"]}}));
    assert_eq!(raw.receive(), None);
    assert_eq!(*bench.seen.lock().unwrap(), ["1", "2", "^A", "read 0x0002 1", "3"]);
}

#[test]
fn a_flood_of_pipelined_calls_is_answered_whole() {
    let bench = Bench::new();
    let mut raw = Raw::new(&bench);
    let mut writer = raw.stream.try_clone().unwrap();
    let feeder = std::thread::spawn(move || {
        for _ in 0..3000 {
            writer.write_all(&call("GetInfo", json!({}))).unwrap();
        }
    });
    for _ in 0..3000 {
        assert_eq!(raw.receive().unwrap()["parameters"]["name"], "pmac0");
    }
    feeder.join().unwrap();
}

#[test]
fn wrong_parameters_are_named_and_the_connection_lives() {
    let bench = Bench::new();
    let mut raw = Raw::new(&bench);
    for (method, parameters, wrong) in [
        ("Send", json!({}), "line"),
        ("Send", json!({"line": 3}), "line"),
        ("Send", json!({"line": "?", "timeout_ms": "soon"}), "timeout_ms"),
        ("Send", json!({"line": "?", "loudly": true}), "loudly"),
        ("Read", json!({"host_offset": 3, "words": 1}), "host_offset"),
        ("SendControl", json!({"character": "^^^"}), "character"),
    ] {
        raw.call(method, parameters);
        let reply = raw.receive().unwrap();
        assert_eq!(reply["error"], "org.varlink.service.InvalidParameter");
        assert_eq!(reply["parameters"]["parameter"], wrong);
    }
    raw.call("Messages", json!({}));
    assert_eq!(raw.receive().unwrap()["error"], "org.varlink.service.ExpectedMore");
    raw.send(b"{\"method\":\"x.y.Z\",\"parameters\":null}\0");
    assert_eq!(raw.receive().unwrap()["error"], "org.varlink.service.InterfaceNotFound");
    assert!(bench.seen.lock().unwrap().is_empty());
}

#[test]
fn what_is_not_a_call_is_said_and_the_connection_closed() {
    let bench = Bench::new();
    for garbage in
        ["", "hello", "[]", "{}", "{\"method\":1}", "{\"method\":\"a.B\",\"parameters\":[]}", "\u{1}\u{ff}"]
    {
        let mut raw = Raw::new(&bench);
        raw.send(garbage.as_bytes());
        raw.send(b"\0");
        let reply = raw.receive().unwrap();
        assert_eq!(reply["error"], "org.varlink.service.InvalidParameter", "{garbage:?}");
        assert_eq!(reply["parameters"]["parameter"], "message");
        assert_eq!(raw.receive(), None);
    }
}

#[test]
fn an_oversized_message_is_said_and_the_connection_closed() {
    let bench = Bench::new();
    let mut raw = Raw::new(&bench);
    // The server may close before all of it is out.
    let _ = raw.stream.write_all(&vec![b'x'; 1 << 20]);
    let reply = raw.receive().unwrap();
    assert!(reply["parameters"]["expected"].as_str().unwrap().contains("65536"), "{reply}");
    assert_eq!(raw.receive(), None);
    assert!(connect(&bench).info().is_ok());
}

#[test]
fn a_half_sent_message_is_given_up() {
    let bench = Bench::with(|options| options.patience = Duration::from_millis(200));
    let mut idle = Raw::new(&bench);
    let mut half = Raw::new(&bench);
    half.send(b"{\"method\":");
    assert!(connect(&bench).info().is_ok());
    assert_eq!(half.receive(), None);
    // Saying nothing at all is not half sending.
    idle.call("GetInfo", json!({}));
    assert!(idle.receive().is_some());
}

#[test]
fn a_client_that_fetches_nothing_is_dropped() {
    let bench = Bench::with(|options| options.patience = Duration::from_millis(200));
    let mut deaf = Raw::new(&bench);
    deaf.stream.set_write_timeout(Some(Duration::from_millis(500))).unwrap();
    let ask =
        json!({"method": "org.varlink.service.GetInterfaceDescription", "parameters": {"interface": BOARD}});
    let ask = format!("{ask}\0").into_bytes();
    let deadline = Instant::now() + PATIENCE;
    // Until the server has had enough.
    while deaf.stream.write_all(&ask).is_ok() {
        assert!(Instant::now() < deadline, "the server takes in what nobody fetches");
    }
    assert!(connect(&bench).info().is_ok());
    deaf.stream.set_nonblocking(true).unwrap();
    let mut sink = vec![0; 1 << 20];
    loop {
        assert!(Instant::now() < deadline, "the connection was not closed");
        match deaf.stream.read(&mut sink) {
            Ok(0) => break,
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {
                std::thread::sleep(Duration::from_millis(10));
            }
            Ok(_) => {}
            Err(_) => break,
        }
    }
}

#[test]
fn a_client_that_leaves_in_mid_command_disturbs_nobody() {
    let bench = Bench::new();
    for number in 0..at_once::LINES {
        let mut leaving = Raw::new(&bench);
        leaving.call("Send", json!({"line": format!("HOLD{number}")}));
        leaving.call("Send", json!({"line": "never begun"}));
        bench.wait_seen(&format!("HOLD{number}"));
        drop(leaving);
    }
    let mut board = connect(&bench);
    assert!(board.control(RELEASE).unwrap().is_empty());
    assert_eq!(board.send("mine", PATIENCE).unwrap(), ["mine"]);
    assert!(!bench.seen.lock().unwrap().iter().any(|line| line == "never begun"));
}

#[test]
fn a_oneway_call_is_carried_out_though_its_caller_has_gone() {
    let bench = Bench::new();
    let mut raw = Raw::new(&bench);
    let oneway =
        json!({"method": format!("{BOARD}.Send"), "parameters": {"line": "goodbye"}, "oneway": true});
    raw.send(format!("{oneway}\0").as_bytes());
    drop(raw);
    bench.wait_seen("goodbye");
}

#[test]
fn messages_reach_every_listener_and_no_reply() {
    let bench = Bench::new();
    let mut listeners = [connect(&bench).messages().unwrap(), connect(&bench).messages().unwrap()];
    let mut board = connect(&bench);
    for listener in &mut listeners {
        // Nothing says when the server has taken up the stream, so texts are sent until one arrives.
        let deadline = Instant::now() + PATIENCE;
        let message = loop {
            bench.unsolicited("tool change");
            if let Some(message) = listener.next_within(Duration::from_millis(50)).unwrap() {
                break message;
            }
            assert!(Instant::now() < deadline);
        };
        assert_eq!(
            (message.text.as_str(), message.kind, message.time_ns),
            ("tool change", MessageKind::Send, 42)
        );
        assert_eq!(message.lost, 0);
    }
    bench.unsolicited("one more");
    assert_eq!(board.send("1", PATIENCE).unwrap(), ["1"]);
}

#[test]
fn a_slow_listener_is_told_how_much_it_lost() {
    let bench = Bench::with(|options| options.patience = Duration::from_millis(200));
    let mut slow = Raw::new(&bench);
    slow.send(format!("{}\0", json!({"method": format!("{BOARD}.Messages"), "more": true})).as_bytes());
    let mut board = connect(&bench);
    let sent = 20_000;
    for number in 0..sent {
        bench.unsolicited(&format!("{number:0200}"));
        if number % 500 == 0 {
            // Lets the server empty its queue, and shows that it lives.
            board.info().unwrap();
        }
    }
    board.info().unwrap();
    let (mut heard, mut lost) = (0_u64, 0);
    let mut next = None;
    let deadline = Instant::now() + PATIENCE;
    loop {
        assert!(Instant::now() < deadline);
        if heard + lost >= sent && next.is_some() {
            break;
        }
        bench.unsolicited("last");
        let Some(reply) = slow.receive() else { panic!("the listener was dropped") };
        assert_eq!(reply["continues"], true);
        let parameters = &reply["parameters"];
        lost += parameters["lost"].as_u64().unwrap();
        heard += 1;
        if parameters["text"] == "last" {
            next = Some(());
        }
    }
    assert!(lost > 0, "heard {heard}");
}

#[test]
fn too_many_clients_are_told_so() {
    let bench = Bench::with(|options| options.max_clients = 3);
    let listen = format!("{}\0", json!({"method": format!("{BOARD}.Messages"), "more": true}));
    let mut clients: Vec<_> = (0..3).map(|_| Raw::new(&bench)).collect();
    for client in &mut clients {
        client.send(listen.as_bytes());
    }
    // None of them is idle, whether its call has been read or not.
    let mut raw = Raw::new(&bench);
    assert_eq!(error_name(&raw.receive().unwrap()), "Unavailable");
    assert_eq!(raw.receive(), None);
    drop(clients.pop());
    let deadline = Instant::now() + PATIENCE;
    while Connection::open(&bench.socket).unwrap().info().is_err() {
        assert!(Instant::now() < deadline);
    }
}

#[test]
fn idle_connections_of_a_user_do_not_lock_his_abort_out() {
    let bench = Bench::with(|options| options.max_clients = 4);
    let mut tracing = Raw::new(&bench);
    tracing.call("Trace", json!({}));
    assert_eq!(tracing.receive().unwrap().get("error"), None);
    let mut listening = Raw::new(&bench);
    listening.send(format!("{}\0", json!({"method": format!("{BOARD}.Messages"), "more": true})).as_bytes());
    // One has asked something, and one nothing since it came.
    let mut idle = connect(&bench);
    idle.info().unwrap();
    let mut silent = Raw::new(&bench);
    let mut first = connect(&bench);
    first.control(1).unwrap();
    assert_eq!(silent.receive(), None);
    let mut second = connect(&bench);
    second.control(1).unwrap();
    idle.info().unwrap_err();
    assert_eq!(bench.seen(), ["^A", "^A"]);
    // What does something for its client stays.
    tracing.call("Trace", json!({}));
    assert_eq!(tracing.receive().unwrap().get("error"), None);
    bench.unsolicited("heard");
    assert_eq!(listening.receive().unwrap()["parameters"]["text"], "heard");
}

#[test]
fn stopping_answers_those_who_wait_and_removes_the_socket() {
    let mut bench = Bench::new();
    let mut raw = Raw::new(&bench);
    raw.call("Send", json!({"line": "SILENT"}));
    bench.wait_seen("SILENT");
    bench.stop_server();
    assert_eq!(error_name(&raw.receive().unwrap()), "Interrupted", "the board may have done it");
    assert_eq!(raw.receive(), None);
    assert!(!bench.socket.exists());
    let error = Connection::open(&bench.socket).unwrap_err().to_string();
    assert!(error.contains("pmac0.sock") && error.contains("is pmacd running"), "{error}");
    assert!(Connection::open(no_socket()).is_err());
}

#[test]
fn a_late_reply_is_not_taken_for_the_next_one() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("pmac0.sock");
    let listener = std::os::unix::net::UnixListener::bind(&path).unwrap();
    let daemon = std::thread::spawn(move || {
        let (mut stopped, _) = listener.accept().unwrap();
        let (mut alive, _) = listener.accept().unwrap();
        // The first connection's caller has given up by now.
        assert!(alive.read(&mut [0; 512]).unwrap() > 0);
        let _ = stopped.write_all(b"{\"parameters\":{\"lines\":[\"late\"]}}\0");
        alive.write_all(b"{\"parameters\":{\"lines\":[\"right\"]}}\0").unwrap();
    });
    let mut board = Connection::open(&path).unwrap();
    let error = board.send("1", Duration::from_millis(20)).unwrap_err();
    assert!(matches!(error, CommandError::NoAnswer { .. }), "{error}");
    assert_eq!(board.send("2", PATIENCE).unwrap(), ["right"]);
    daemon.join().unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn garbage_neither_stalls_nor_reaches_the_board(
        chunks in proptest::collection::vec(
            prop_oneof![
                proptest::collection::vec(any::<u8>(), 0..64),
                Just(b"\0".to_vec()),
                Just(b"{\"method\":\"io.github.pmac-dpram.Board.Send\",\"parameters\":{\"line\":\"\\u0001\"}}\0".to_vec()),
                Just(b"{\"method\":\"io.github.pmac-dpram.Board.GetInfo\"".to_vec()),
                Just(b"{\"method\":\"org.varlink.service.GetInfo\"}\0".to_vec()),
            ],
            0..12,
        ),
    ) {
        thread_local! {
            static BENCH: Bench = Bench::new();
        }
        BENCH.with(|bench| {
            let mut raw = Raw::new(bench);
            for chunk in &chunks {
                // The server may have closed already.
                let _ = raw.stream.write_all(chunk);
            }
            let _ = raw.stream.shutdown(Shutdown::Write);
            while raw.receive().is_some() {}
            assert_eq!(connect(bench).info().unwrap().motors, 8);
            assert!(bench.seen.lock().unwrap().is_empty());
        });
    }
}
