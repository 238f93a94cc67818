//! The board's own interrupt controller behind the ISA host port, of both families: no interrupt is lost.

use std::time::Duration;

use pmac_dpram::protocol::HostPortCounts;
use pmac_dpram::segment::Counter;

use crate::support::{PATIENCE, VirtualSite, counter};

fn board(family: &str) -> VirtualSite {
    let site = VirtualSite::new();
    let registers = site.path("host-port").display().to_string();
    let config = site.path("config").display().to_string();
    std::fs::write(
        &config,
        format!("family = \"{family}\"\n[host_port]\nregisters = \"file:{registers}\"\n"),
    )
    .unwrap();
    site.start_simulator(&["--dpram-startup", "--family", family, "--host-port", &registers]);
    site.start_daemon(&["--config", &config]);
    site.wait_for_identity();
    site
}

fn counts(site: &VirtualSite) -> HostPortCounts {
    site.connection().info().unwrap().host_port.expect("a host port").counts
}

/// The mask register as the controller has it.
fn mask(site: &VirtualSite, family: &str) -> u8 {
    std::fs::read(site.path("host-port")).unwrap()[if family == "pmac" { 9 } else { 10 }]
}

const FAMILIES: [(&str, u8, u8); 2] = [("pmac", 0x7F, 0xFF), ("pmac2", 0x20, 0x00)];

#[test]
fn every_response_is_announced_because_every_interrupt_is_acknowledged() {
    for (family, open, shut) in FAMILIES {
        let site = board(family);
        assert_eq!(mask(&site, family), open, "{family}: our line, and no other");
        let subscriber = site.attach();
        let mut messages = site.connection().messages().unwrap();
        let mut connection = site.connection();
        connection.send("P1=5", PATIENCE).unwrap();
        // Spread out, so that each finds the port idle: only an interrupt announces it.
        for round in 0..20 {
            let before = counter(&subscriber, Counter::Interrupts);
            site.control(&format!("send DOOR {round}"));
            let message = messages.next_within(PATIENCE).unwrap().expect("a message in time");
            assert_eq!(message.text, format!("DOOR {round}"));
            site.wait_until("its interrupt", || counter(&subscriber, Counter::Interrupts) > before);
            assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["5"]);
        }
        let HostPortCounts { served, old, .. } = counts(&site);
        assert!(served >= 20 && old <= served, "{family}: {served} {old}");
        let (_, stdout, _) = site.pmacctl(&["status"]);
        assert!(stdout.contains("host port       p"), "{stdout}");
        let (status, stdout, _) = site.pmacctl(&["doctor"]);
        assert!(status == 0 && stdout.contains("interrupts served"), "{stdout}");
        site.assert_no_violations();
        site.stop_daemon();
        assert_eq!(mask(&site, family), shut, "{family}: as it was found");
    }
}

#[test]
fn without_the_acknowledgement_there_is_no_other_interrupt() {
    for (family, _, _) in FAMILIES {
        let site = board(family);
        let subscriber = site.attach();
        let mut connection = site.connection();
        // The controller does not hear us: what is raised once stays in service.
        site.control("fault host_port_stuck on");
        for _ in 0..3 {
            assert_eq!(connection.send("VERSION", PATIENCE).unwrap(), ["1.16D"], "by looking");
        }
        let before = counter(&subscriber, Counter::Interrupts);
        for _ in 0..5 {
            assert_eq!(connection.send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
        }
        assert_eq!(counter(&subscriber, Counter::Interrupts), before, "{family}");
        site.control("fault host_port_stuck off");
        // The acknowledgement that was due is given when it has been waited for in vain.
        site.wait_until("interrupts again", || {
            assert_eq!(connection.send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
            site.run_for(Duration::from_millis(20));
            counter(&subscriber, Counter::Interrupts) > before
        });
        // Counts are told with the heartbeat.
        site.wait_until("the count to be told", || counts(&site).unannounced > 0);
        site.assert_no_violations();
    }
}

#[test]
fn an_interrupt_without_a_response_is_an_old_one() {
    for (family, _, _) in FAMILIES {
        let site = board(family);
        site.wait_until("the port to be idle", || {
            let before = counts(&site);
            site.run_for(Duration::from_millis(200));
            counts(&site) == before
        });
        let before = counts(&site);
        site.control("fault spurious_interrupt 3");
        site.wait_until("old ones to be counted", || counts(&site).old > before.old);
        assert_eq!(site.connection().send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
        site.assert_no_violations();
    }
}

#[test]
fn the_line_is_opened_again_after_the_simulator_was_started_again() {
    let (family, open, _) = FAMILIES[0];
    let site = board(family);
    let registers = site.path("host-port").display().to_string();
    site.kill_simulator();
    site.start_simulator(&["--dpram-startup", "--family", family, "--host-port", &registers]);
    site.wait_until("the line to be open", || mask(&site, family) == open);
    assert_eq!(site.connection().send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    site.assert_no_violations();
}
