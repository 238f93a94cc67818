//! The address that the rotary buffers go by, and its sender.

use super::*;
use crate::daemon::shared::writer::Account;

const ANNE: Account = Account { uid: 1000, pid: 1 };
const OPENER: Writer = Writer::Hand(ANNE);
const BOB: Writer = Writer::Hand(Account { uid: 1001, pid: 2 });

fn before(address: &RotaryAddress, line: &str, writer: Writer, enters: bool) -> Option<AddressFirst> {
    address.before(&Meaning::of(line), writer, OPENER, enters)
}

fn goes(address: &mut RotaryAddress, line: &str, writer: Writer) {
    address.goes(&Meaning::of(line), writer, OPENER);
}

#[test]
fn what_somebody_else_addresses_is_put_back_before_the_openers_next_line() {
    let mut address = RotaryAddress::default();
    assert_eq!(before(&address, "X10", OPENER, true), None);
    assert_eq!(before(&address, "#2J+", BOB, false), None, "it addresses no coordinate system");
    assert_eq!(before(&address, "&2%50", BOB, false), Some(AddressFirst::Ask));
    address.told(Some(1));
    assert_eq!(before(&address, "&2%50", BOB, false), None);
    goes(&mut address, "&2%50", BOB);
    assert_eq!(before(&address, "&3%", BOB, false), None, "what is to be put back is known");
    goes(&mut address, "&3%", BOB);
    assert_eq!(before(&address, "X10", OPENER, true), Some(AddressFirst::PutBack(1)));
    assert_eq!(before(&address, "& 4 X10", OPENER, true), None, "it says itself whose it is");
    assert_eq!(before(&address, "CLOSE", OPENER, false), None);
    address.is_back();
    assert_eq!(before(&address, "X10", OPENER, true), None);
    goes(&mut address, "&4X10", OPENER);
    assert_eq!(before(&address, "&2%50", BOB, false), Some(AddressFirst::Ask), "the opener has another one");
}

#[test]
fn a_stop_does_not_wait_and_what_nobody_can_put_back_bars_the_next_line() {
    let mut address = RotaryAddress::default();
    for line in ["&2A", "&2 q", "#1J/&2", "&1\\\\", "&2H"] {
        assert_eq!(before(&address, line, BOB, false), None, "{line}");
    }
    goes(&mut address, "&2A&1", Writer::Stop);
    assert_eq!(before(&address, "X10", OPENER, true), None, "it has put back what was addressed");
    goes(&mut address, "&2A", Writer::Stop);
    assert_eq!(before(&address, "X10", OPENER, true), Some(AddressFirst::Unknown));
    goes(&mut address, "&1X10", OPENER);
    assert_eq!(before(&address, "X10", OPENER, true), None);
    address.told(None);
    assert_eq!(before(&address, "&2%50", BOB, false), None, "the board does not say: it is asked once");
    goes(&mut address, "&2%50", BOB);
    assert_eq!(before(&address, "X10", OPENER, true), Some(AddressFirst::Unknown));
}

#[test]
fn one_users_commands_by_hand_are_one_but_not_those_of_two_terminals() {
    let mut address = RotaryAddress::default();
    let [other, third] = [9, 10].map(|pid| Writer::Hand(Account { pid, ..ANNE }));
    assert_eq!(before(&address, "&2%50", other, false), Some(AddressFirst::Ask));
    address.told(Some(1));
    goes(&mut address, "&2%50", other);
    assert_eq!(before(&address, "X10", third, true), None);
    assert_eq!(before(&address, "X10", Writer::IntoBuffer(ANNE), true), Some(AddressFirst::PutBack(1)));
    goes(&mut address, "&3%50", BOB);
    assert_eq!(before(&address, "X10", third, true), Some(AddressFirst::Unknown), "&2 was hers");
}
