//! Files that people hand to the tools: program files with names and includes, saved variables, memory images.

use std::cell::Cell;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use pmac_dpram::cli::settings_file as variables;
use pmac_dpram::decode::{Image, Scales, value};
use pmac_dpram::format::{Float48Layout, WordOrder};
use pmac_dpram::map::{Family, HostOffset, Space, TypedAddress};
use pmac_dpram::preprocess::preprocess;
use pmac_dpram::protocol::{LINE_MAX, check_line};

use super::tape::Tape;

/// First byte: what the rest is.
pub fn body(data: &[u8]) {
    let Some((&way, rest)) = data.split_first() else { return };
    match way % 4 {
        0 | 1 => program(rest),
        2 => saved(&String::from_utf8_lossy(rest)),
        _ => image(rest),
    }
}

/// Files apart by 0x00, the first one is `a`, the next `b` and so on. A short input makes no long work.
fn program(bytes: &[u8]) {
    let files: Vec<&[u8]> = bytes.split(|&byte| byte == 0).take(8).collect();
    let reads = Cell::new(0u32);
    let read = |path: &Path| {
        reads.set(reads.get() + 1);
        let name = path.to_str().and_then(|name| name.bytes().next());
        let file = name.and_then(|name| files.get(usize::from(name.wrapping_sub(b'a'))));
        file.map(|file| file.to_vec()).ok_or_else(|| "not there".to_owned())
    };
    let result = preprocess(&[PathBuf::from("a")], &read);
    assert!(reads.get() <= 1001, "{} files were read", reads.get());
    match result {
        Ok(lines) => {
            for line in lines {
                assert_eq!(check_line(&line.text), Ok(()));
                assert!(line.text.len() <= LINE_MAX && line.place.line > 0);
            }
        }
        Err(mistakes) => {
            assert!(!mistakes.is_empty());
            assert!(mistakes.iter().all(|mistake| mistake.to_string().len() < 64 * 1024));
        }
    }
}

/// Saved settings: what was read, written again as the tools write it, reads the same.
fn saved(text: &str) {
    match variables::parse("f", text) {
        Err(mistakes) => assert!(!mistakes.is_empty() && mistakes.len() <= text.lines().count()),
        Ok(entries) => {
            let lines: Vec<String> = entries.iter().flat_map(|entry| entry.item.lines(&entry.text)).collect();
            let again =
                variables::parse("f", &lines.join("\n")).expect("what was read is written as it is read");
            assert_eq!(again.len(), entries.len());
            let mut seen = HashSet::new();
            for (one, other) in entries.iter().zip(&again) {
                assert!(one.item == other.item && one.item.same(&one.text, &other.text));
                assert!(seen.insert(one.item), "set twice");
            }
        }
    }
}

/// A dump of the memory: the input again and again, so that a short one fills it.
fn image(bytes: &[u8]) {
    let mut tape = Tape::new(bytes);
    let (way, offset) = (tape.u8(), u32::from(tape.u16()));
    let family = Family::by_name(["pmac", "pmac2", "turbo", "turbo2"][usize::from(way % 4)]).unwrap();
    let order = if way & 4 == 0 { WordOrder::Little } else { WordOrder::Swapped };
    let layout = if way & 8 == 0 { Float48Layout::Register } else { Float48Layout::Printed };
    let dump = tape.rest();
    assert!(dump.len() == family.length as usize || Image::from_bytes(dump, family, order).is_err());
    if dump.is_empty() {
        return;
    }
    // Only the reports are decoded: the first 2 KiB are the input's, the rest is zero.
    let mut whole = vec![0; family.length as usize];
    whole[..0x800].iter_mut().zip(dump.iter().cycle()).for_each(|(to, from)| *to = *from);
    let image = Image::from_bytes(&whole, family, order).expect("as long as it has to be");
    let motors = usize::from(way >> 4) % (family.motors + 1);
    let scales = Scales::default();
    if let Ok(servo) = image.servo(motors, &scales) {
        // A block that no board writes is no motor's.
        assert!(servo.motors.len() <= motors);
        let _ = servo.global_flags().iter().flatten().map(|flags| flags.names().count()).sum::<usize>();
    }
    if let Ok(background) = image.background(motors, &scales, layout) {
        assert!(background.motors.len() <= motors.max(8));
    }
    if let Some(offset) = HostOffset::checked(offset) {
        for space in Space::ALL {
            if let Some(words) = image.words().get(offset.word()..) {
                let location = TypedAddress { space, offset };
                // Not a number is not equal to itself.
                let (one, other) = (value::value(space, words, layout), image.value(location, layout));
                assert_eq!(format!("{one:?}"), format!("{other:?}"));
            }
        }
    }
}
