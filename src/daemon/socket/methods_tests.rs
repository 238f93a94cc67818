//! Which calls each method takes, and from which role.

use super::*;
use crate::map::PMAC;
use crate::map::functions::RESPONSE_BYTES;
use crate::protocol::{BoardInfo, BoardSettings};
use serde_json::Value;

fn called(role: Role, method: &str, parameters: Value) -> Result<Action, CallError> {
    let call: Call = serde_json::from_value(json!({"method": method, "parameters": parameters})).unwrap();
    parse_call(
        &call,
        role,
        Characters::default(),
        &Info::new(&PMAC, BoardInfo::default(), BoardSettings::default()),
    )
}

fn board(role: Role, method: &str, parameters: Value) -> Result<Action, CallError> {
    called(role, &format!("{BOARD}.{method}"), parameters)
}

#[test]
fn each_method_needs_its_role() {
    for (method, parameters, needed) in [
        ("GetInfo", json!({}), Role::Observe),
        ("Read", json!({"host_offset": 0, "words": 1}), Role::Observe),
        ("SendControl", json!({"character": "^A"}), Role::Stop),
        ("SendControl", json!({"character": "^K"}), Role::Stop),
        ("SendControl", json!({"character": "^O"}), Role::Stop),
        ("SendControl", json!({"character": "^R"}), Role::Operate),
        ("SendControl", json!({"character": "^D"}), Role::Engineer),
        ("SendControl", json!({"character": "^Z", "confirmed": true}), Role::Engineer),
        ("Panel", json!({"action": "stop", "numbers": [1]}), Role::Stop),
        ("Panel", json!({"action": "hold", "numbers": [1]}), Role::Stop),
        ("Panel", json!({"action": "jog-stop", "numbers": [1]}), Role::Stop),
        ("Panel", json!({"action": "jog+", "numbers": [1]}), Role::Operate),
        ("Panel", json!({"action": "step", "numbers": [1]}), Role::Operate),
        ("PanelHold", json!({"action": "jog+", "numbers": [1]}), Role::Operate),
        ("JogTo", json!({"motor": 1, "position": -0.5}), Role::Operate),
        ("SetPosition", json!({"motor": 1, "position": -0.5}), Role::Engineer),
        ("Panel", json!({"action": "home", "numbers": [1], "by_line": true}), Role::Operate),
        ("Panel", json!({"action": "start", "numbers": [1], "by_line": true}), Role::Operate),
        ("Panel", json!({"action": "hold", "numbers": [1], "by_line": true}), Role::Stop),
        ("FeedOverride", json!({"coordinate_system": 1, "raw": 0}), Role::Stop),
        ("FeedOverride", json!({"coordinate_system": 1, "raw": 1}), Role::Operate),
        ("FeedOverride", json!({"coordinate_system": 1, "raw": null}), Role::Operate),
        ("Send", json!({"line": "#1J+"}), Role::Engineer),
        ("Send", json!({"line": "P1 Q2 I122,5,100"}), Role::Observe),
        ("Send", json!({"line": "P0..49"}), Role::Observe),
        ("Send", json!({"line": "P0..50"}), Role::Engineer),
        ("Send", json!({"line": "P0..49 Q1"}), Role::Engineer),
        ("Send", json!({"line": "M1"}), Role::Engineer),
        ("Send", json!({"line": "M1->"}), Role::Engineer),
        ("Send", json!({"line": "P(M1)"}), Role::Engineer),
        ("Send", json!({"line": "P1 P2=3"}), Role::Engineer),
        ("Send", json!({"line": "P1=P2"}), Role::Engineer),
        ("Send", json!({"line": "I100..120=0"}), Role::Engineer),
        ("Send", json!({"line": "&2Q1"}), Role::Engineer),
        ("Send", json!({"line": "#1P"}), Role::Engineer),
        ("Send", json!({"line": "RX$0028"}), Role::Engineer),
        ("Send", json!({"line": "P1 K"}), Role::Engineer),
    ] {
        for role in Role::ALL {
            let found = board(role, method, parameters.clone());
            let refused = matches!(&found, Err(CallError::NotPermitted { role_needed })
                if *role_needed == needed.to_string());
            assert_eq!(refused, role < needed, "{method} by {role}: {found:?}");
            assert_eq!(found.is_ok(), role >= needed);
        }
    }
}

#[test]
fn the_lines_of_others_are_for_engineers() {
    let ascii = &PMAC.ascii;
    let read = |role, offset: u32, words| {
        board(role, "Read", json!({"host_offset": offset, "words": words})).map(drop)
    };
    let (command, response) = (ascii.command.bytes(), ascii.response.bytes());
    let ends = [command + ascii.command_bytes as u32, response + RESPONSE_BYTES as u32];
    for (start, end) in [command, response].into_iter().zip(ends) {
        for (offset, words) in [(start, 1), (start - 2, 2), (end - 2, 1), (start - 2, 64)] {
            let refused = read(Role::Operate, offset, words).unwrap_err();
            assert!(matches!(refused, CallError::NotPermitted { role_needed } if role_needed == "engineer"));
            read(Role::Engineer, offset, words).unwrap();
        }
        read(Role::Observe, start - 2, 1).unwrap();
        read(Role::Observe, end, 1).unwrap();
    }
}

#[test]
fn registers_outside_memory_are_for_engineers() {
    let watch = |role, registers: &[&str]| {
        let parameters = json!({ "registers": registers });
        let call =
            json!({"method": format!("{BOARD}.WatchVariables"), "more": true, "parameters": parameters});
        let call: Call = serde_json::from_value(call).unwrap();
        parse_call(
            &call,
            role,
            Characters::default(),
            &Info::new(&PMAC, BoardInfo::default(), BoardSettings::default()),
        )
    };
    for memory in ["X:$0", "Y:$BFFF", "X:$D009", "Y:$DFFF"] {
        watch(Role::Observe, &[memory]).unwrap();
    }
    // The board's own addresses of command lines ($D18C to $D1B3) and responses ($D1B5 to $D1F4): they may be
    // passwords.
    for memory in ["Y:$D18B", "Y:$D1F5"] {
        watch(Role::Observe, &[memory]).unwrap();
    }
    for hardware in ["Y:$C000", "X:$E006", "Y:$FFC2", "D:$D18C", "Y:$D18D", "X:$D1B3", "Y:$D1B5", "L:$D1F4"] {
        for role in [Role::Observe, Role::Operate] {
            let refused = watch(role, &["X:$0", hardware]).unwrap_err();
            assert!(matches!(refused, CallError::NotPermitted { .. }), "{hardware}");
        }
        watch(Role::Engineer, &[hardware]).unwrap();
    }
}

#[test]
fn a_method_of_a_function_that_is_switched_off_says_so() {
    let with = |functions: Value| {
        let settings =
            BoardSettings { functions: serde_json::from_value(functions).unwrap(), ..Default::default() };
        Info::new(&PMAC, BoardInfo::default(), settings)
    };
    let methods = BOARD_DESCRIPTION.lines().filter_map(|line| line.strip_prefix("method "));
    let methods: Vec<_> = methods.filter_map(|line| line.split('(').next()).collect();
    assert_eq!(methods.len(), 28, "{methods:?}");
    for method in methods {
        let call = json!({"method": format!("{BOARD}.{method}"), "parameters": {}});
        let call: Call = serde_json::from_value(call).unwrap();
        let reason = |functions: Value| match parse_call(
            &call,
            Role::Engineer,
            Characters::default(),
            &with(functions),
        ) {
            Err(CallError::Refused { reason }) => reason,
            _ => String::new(),
        };
        let refused = |functions: Value| reason(functions).contains("is switched off");
        // A line stops the target if the panel is off; without lines the call needs the panel.
        let of_panel = (method == "Panel").then_some(Function::Panel);
        let needed = of_panel.or(METHODS.iter().find(|known| known.name == method).unwrap().function);
        let other = if needed == Some(Function::Rotary) { Function::Servo } else { Function::Rotary };
        assert_eq!(refused(json!([other])), needed.is_some(), "{method}");
        // The daemon uses no function: it does not know the board's family.
        let writes = needed.is_some() || method == "Write";
        assert_eq!(reason(json!([])) == UNKNOWN_FAMILY, writes, "{method}");
        assert_eq!(
            needed.is_none(),
            ["GetInfo", "GetSettings", "SequenceRenew", "JogRenew", "Note", "Read", "Trace", "Write"]
                .contains(&method)
        );
        assert!(!needed.is_some_and(|function| refused(json!([function, Function::Ascii]))), "{method}");
    }
}

#[test]
fn nothing_out_of_bounds_passes() {
    let engineer = |method, parameters| board(Role::Engineer, method, parameters).unwrap_err();
    let is_invalid = |error, name: &str| {
        assert!(
            matches!(&error, CallError::InvalidParameter { parameter, .. } if parameter == name),
            "{error:?}"
        );
    };
    let read = |offset: i64, words: i64| engineer("Read", json!({"host_offset": offset, "words": words}));
    for offset in [1, -2, 0x4000, i64::from(u32::MAX) - 1, i64::MAX] {
        is_invalid(read(offset, 1), "host_offset");
        let words = json!({"host_offset": offset, "words": [1], "anywhere": true});
        is_invalid(engineer("Write", words), "host_offset");
    }
    is_invalid(read(0, 0), "words");
    for text in [String::new(), "x".repeat(201)] {
        is_invalid(engineer("Note", json!({"text": text})), "text");
    }
    is_invalid(read(0, 65), "words");
    assert_eq!(read(0x3FFE, 2), CallError::OutOfRange);
    for (method, parameters, name) in [
        ("WatchVariables", json!({"registers": vec!["Y:$0003"; 200]}), "registers"),
        ("WatchVariables", json!({"registers": []}), "registers"),
        ("RotaryState", json!({"buffer": 9}), "buffer"),
        (
            "RotaryStart",
            json!({"buffer": 1, "coordinate_system": 99, "coordinate_system_base": 1}),
            "coordinate_system",
        ),
        (
            "RotaryStart",
            json!({"buffer": 1, "start": 0x4000, "coordinate_system": 1, "coordinate_system_base": 1}),
            "start",
        ),
        (
            "RotaryStart",
            json!({"buffer": 1, "coordinate_system": 1, "coordinate_system_base": 2}),
            "coordinate_system_base",
        ),
        ("Panel", json!({"action": "home", "numbers": [99]}), "numbers"),
        ("PanelHold", json!({"action": "jog+", "numbers": [1], "by_line": true}), "by_line"),
        ("Panel", json!({"action": "home", "numbers": [0]}), "numbers"),
        ("Panel", json!({"action": "home", "numbers": []}), "numbers"),
        ("FeedOverride", json!({"coordinate_system": 9}), "coordinate_system"),
        ("FeedOverride", json!({"coordinate_system": 1, "raw": 32768}), "raw"),
    ] {
        is_invalid(engineer(method, parameters), name);
    }
    let after_the_end = json!({"host_offset": 0x3FFE, "words": [1, 2]});
    assert_eq!(engineer("Write", after_the_end), CallError::OutOfRange);
    assert!(board(Role::Engineer, "Write", json!({"host_offset": 0x3FFE, "words": [1]})).is_ok());
    for timeout in [0, -1, 600_001] {
        let error = engineer("Send", json!({"line": "?", "timeout_ms": timeout}));
        is_invalid(error, "timeout_ms");
    }
    is_invalid(engineer("Send", json!({"line": "?", "silence_ms": 1000})), "silence_ms");
    assert!(matches!(engineer("Send", json!({"line": "a\rb"})), CallError::InvalidLine { .. }));
    is_invalid(engineer("Send", json!({"line": "?", "extra": 1})), "extra");
    is_invalid(engineer("SendControl", json!({"character": "K"})), "character");
    assert_eq!(engineer("Messages", json!({})), CallError::ExpectedMore);
}

#[test]
fn unknown_names_are_said_back() {
    let unknown = called(Role::Engineer, "a.b.C", json!({})).unwrap_err();
    assert_eq!(unknown, CallError::InterfaceNotFound { interface: "a.b".to_owned() });
    let unknown = board(Role::Engineer, "Nothing", json!({})).unwrap_err();
    assert_eq!(unknown, CallError::MethodNotFound { method: format!("{BOARD}.Nothing") });
    assert!(called(Role::Engineer, "NoDot", json!({})).is_err());
    let unknown =
        called(Role::Engineer, "org.varlink.service.GetInterfaceDescription", json!({"interface": "x.y"}));
    assert_eq!(unknown.unwrap_err(), CallError::InterfaceNotFound { interface: "x.y".to_owned() });
}
