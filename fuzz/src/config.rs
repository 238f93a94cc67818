//! The daemon's configuration file, and the specifications in it and on the command line.

use std::cell::RefCell;
use std::fs::File;
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use pmac_dpram::daemon::config::settings::Settings;
use pmac_dpram::daemon::options::Options;
use pmac_dpram::device::{BoardSpec, ByteSpec, InterruptSource, board::pci::PciAddress};
use pmac_dpram::segment::SegmentName;

/// First byte: whether the rest is a file, or one of the specifications.
pub fn body(data: &[u8]) {
    let Some((&way, rest)) = data.split_first() else { return };
    let text = String::from_utf8_lossy(rest);
    match way % 8 {
        0..=3 => file(rest),
        4 => file(format!("board = {:?}\n", text).as_bytes()),
        5 => drop((text.parse::<BoardSpec>(), text.parse::<ByteSpec>())),
        6 => drop((text.parse::<InterruptSource>(), text.parse::<PciAddress>())),
        _ => {
            if let Ok(name) = SegmentName::new(&text) {
                let plain = name.as_str();
                assert!(plain.len() <= 64 && !plain.contains('/') && !plain.starts_with('.'));
            }
        }
    }
}

thread_local! {
    /// One file in memory, written anew each time.
    static FILE: RefCell<Option<(File, PathBuf)>> = const { RefCell::new(None) };
}

fn file(text: &[u8]) {
    FILE.with_borrow_mut(|file| {
        let (file, path) = file.get_or_insert_with(|| {
            let file = tempfile::tempfile_in("/dev/shm").unwrap();
            let path = format!("/proc/self/fd/{}", file.as_raw_fd()).into();
            (file, path)
        });
        file.write_all_at(text, 0).unwrap();
        file.set_len(text.len() as u64).unwrap();
        let options = Options { config: Some(path.clone()), ..Options::default() };
        match Settings::decide(&options) {
            Ok(settings) => sound(&settings),
            Err(error) => assert_eq!(error.to_string().lines().count(), 1, "{error:?}"),
        }
    });
}

/// What the daemon takes for granted of settings that were accepted.
fn sound(settings: &Settings) {
    assert!(settings.socket_mode <= 0o777 && settings.segment_mode <= 0o777);
    assert!(settings.motors.is_none_or(|motors| (1..=8).contains(&motors)));
    assert!([settings.i10, settings.i19].iter().flatten().all(|value| (1..1 << 23).contains(value)));
    assert!((1_000_000..=10_000_000_000).contains(&settings.background_period_ns));
    assert_eq!(settings.board_settings.settings().rotary.check(), Ok(()));
    assert!(settings.board_settings.layout_for(settings.firmware.as_deref()).is_ok());
}
