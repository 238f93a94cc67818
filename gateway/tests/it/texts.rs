//! Texts that the board's programs send by themselves.

use super::site::{Site, packet, wait_until};

/// A board whose PLC 3 sends a text once when it is enabled.
fn site_that_sends(family: &str) -> Site {
    let site = Site::of(family, &[]);
    for line in ["OPEN PLC 3 CLEAR", "SEND\"hello there\"", "P3=P3+1", "DISABLE PLC 3", "CLOSE", "I5=2"] {
        site.ask(line);
    }
    site
}

/// Has the program send its text.
fn have_it_send(site: &Site) {
    site.ask("P3=0");
    site.ask("ENABLE PLC 3");
    wait_until("the program", || site.ask("P3") == ["1"]);
}

#[test]
fn a_programs_text_comes_behind_the_replies_of_each_client_where_it_is_marked() {
    const TEXT: &[u8] = b"\x02hello there\r";
    for family in ["pmac", "turbo2"] {
        let site = site_that_sends(family);
        let (mut one, mut two) = (site.client(), site.client());
        assert_eq!(one.line("I64=0 P1=25 P2=50"), "\x06");
        have_it_send(&site);
        wait_until("the log", || site.log("pmac-gateway").contains("only where I64=1 marks it"));
        assert_eq!(one.request(0xC0, 0xC2, 0, 2), [0, 0], "nobody could tell it from a reply");
        assert_eq!(one.line("I64=1"), "\x06");
        // For so long the board's last answer is believed.
        std::thread::sleep(std::time::Duration::from_millis(1100));
        have_it_send(&site);
        wait_until("the text", || one.request(0xC0, 0xC2, 0, 2) == [1, 0]);
        assert_eq!(one.get_buffer(), TEXT, "{family}");
        assert_eq!(one.get_buffer(), [0]);
        // The other has fetched nothing yet: his reply is whole, and the text behind it.
        assert_eq!(two.ask(&packet(0x40, 0xB0, 0, 0, 5, b"P1..2")), b"@");
        assert_eq!(two.request(0xC0, 0xB1, 0, 0), b"25\r");
        assert_eq!(two.get_buffer(), b"50\r\x06");
        assert_eq!(two.get_buffer(), TEXT, "{family}");
        assert_eq!(two.request(0xC0, 0xC2, 0, 2), [0, 0]);
        // What empties what is there to be fetched empties this, too.
        have_it_send(&site);
        wait_until("the text", || one.request(0xC0, 0xC2, 0, 2) == [1, 0]);
        assert_eq!(one.line("P1"), "25\r\x06");
        assert_eq!(two.request(0x40, 0xB3, 0, 0), b"@", "FLUSH");
        for client in [&mut one, &mut two] {
            assert_eq!(client.get_buffer(), [0]);
        }
    }
}
