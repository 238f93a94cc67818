//! The words of gathering, variable tables, rotary buffers and control panel in an image, on a few lines.

use std::fmt::Write;

use crate::decode::Buffers;
use crate::decode::buffers::{Gather, Panel, ReadTable, Rotary, WriteTable};
use crate::map::{Family, HostOffset};

/// A line for each function whose words are not all 0.
pub fn text(buffers: &Buffers, family: &Family) -> String {
    let Buffers { panel, gather, variable_read, variable_write, rotary } = buffers;
    let mut text = String::new();
    let mut say = |name: &str, said: Option<String>| {
        if let Some(said) = said {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{name}: {said}");
        }
    };
    say("panel", panel.as_ref().and_then(panel_text));
    say("gather", gather_text(*gather));
    say("variable read", read_text(variable_read));
    say("variable write", variable_write.as_ref().and_then(write_text));
    for buffer in rotary.iter().filter(|buffer| buffer.size_longs > 0) {
        say(&format!("rotary {}", buffer.buffer), Some(rotary_text(buffer, family)));
    }
    text
}

fn panel_text(panel: &Panel) -> Option<String> {
    let Panel { request_enable, override_enable, .. } = panel;
    ((request_enable | override_enable) != 0)
        .then(|| format!("request mask ${request_enable:04X}, feed rate mask ${override_enable:04X}"))
}

fn gather_text(Gather { size_longs, next_long }: Gather) -> Option<String> {
    ((size_longs | next_long) != 0).then(|| format!("{size_longs} longs, the next item goes to {next_long}"))
}

fn read_text(table: &ReadTable) -> Option<String> {
    let ready = |is: bool| if is { "ready" } else { "not ready" };
    let state = match &table.entries {
        None => "which cannot lie where the table begins".to_owned(),
        Some(entries) if table.multi_user => {
            format!("{} of them ready", entries.iter().filter(|entry| entry.ready).count())
        }
        Some(_) => ready(table.ready).to_owned(),
    };
    (table.count > 0).then(|| format!("a table of {}, {state}", table.count))
}

fn write_text(table: &WriteTable) -> Option<String> {
    let place = if table.records.is_some() { "" } else { ", which cannot lie where the table begins" };
    (table.count > 0).then(|| format!("{} still to write{place}", table.count))
}

fn rotary_text(buffer: &Rotary, family: &Family) -> String {
    let Rotary { size_longs, host_index, pmac_index, .. } = buffer;
    let place = match buffer.host_offset.and_then(HostOffset::checked) {
        Some(offset) => format!("at {}", family.print_number(family.pmac_number(offset))),
        None => "at a place that is none".to_owned(),
    };
    let full = if buffer.full { ", PMAC's own buffer is full" } else { "" };
    let error = buffer.error.map_or_else(String::new, |code| format!(", error {code}"));
    format!("{size_longs} longs {place}, host at {host_index}, PMAC at {pmac_index}{full}{error}")
}
