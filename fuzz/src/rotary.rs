//! Motion programs as text and as words: what compiles comes back as text that compiles to the same words, and what is
//! decompiled without a remark compiles to the words it came as.

use pmac_dpram::cli::rotary_words;
use pmac_dpram::map::readings::RotaryCode2;
use pmac_dpram::rotary::{END_MARKER, Line, Program, START_OF_LINE, Settings, compile, decompile};

/// First byte: how the rest is read (program text, pairs of words, a file of words), and settings.
pub fn body(data: &[u8]) {
    let Some((&way, rest)) = data.split_first() else { return };
    let settings = settings(way >> 2);
    assert_eq!(settings.check(), Ok(()));
    match way & 3 {
        0 | 1 => from_text(rest, &settings),
        2 => from_words(&pairs(rest), &settings),
        _ => {
            if let Ok(words) = rotary_words::words(rest) {
                assert!(words.iter().all(|&(word1, word2)| word1 < 1 << 24 && word2 < 1 << 24));
                assert!(words.len() <= rest.len());
                from_words(&words, &settings);
            }
        }
    }
}

fn settings(choice: u8) -> Settings {
    let normal = Settings { rotary_code2: Some(RotaryCode2::Bit16), ..Settings::default() };
    match choice {
        0..48 => normal,
        48..51 => Settings { exponent_bias: 63, zero_exponent: 63, ..normal },
        51..54 => Settings { exponent_bias: 0, rotary_code2: Some(RotaryCode2::Bit12), ..normal },
        54..57 => Settings { mode_code_bit: 12, abs_inc_axis_bit: 0, frax_axis_bit: 0, ..normal },
        57..60 => Settings { mode_code_bit: 19, abs_inc_vector_bit: 23, ..normal },
        _ => Settings { buffer_words: 6, coordinate_system_base: 0, ..normal },
    }
}

fn text_of(program: &Program) -> String {
    program.lines.iter().map(Line::text).collect::<Vec<_>>().join("\n")
}

fn pairs(bytes: &[u8]) -> Vec<(u32, u32)> {
    let word = |bytes: &[u8]| u32::from_be_bytes([0, bytes[0], bytes[1], bytes[2]]);
    bytes.chunks_exact(6).map(|pair| (word(&pair[..3]), word(&pair[3..]))).collect()
}

fn from_text(text: &[u8], settings: &Settings) {
    let compiled = match compile(text, settings) {
        Ok(compiled) => compiled,
        Err(refused) => {
            assert!(!refused.errors.is_empty());
            for error in &refused.errors.listed {
                assert!(!error.what.to_string().contains('\n'));
            }
            return;
        }
    };
    let words: Vec<(u32, u32)> = compiled.program.words().collect();
    assert!(words.len() <= text.len(), "a command has a character at least");
    assert!(words.iter().all(|&(word1, word2)| word1 < 1 << 24 && word2 < 1 << 24));
    for line in &compiled.program.lines {
        assert!(!line.commands.is_empty() && line.commands.len() <= settings.most_commands_a_line());
        for (command, at) in line.commands.iter().zip(0..) {
            assert_eq!(command.word1 & START_OF_LINE != 0, at == 0);
        }
    }
    if words.contains(&END_MARKER) {
        return;
    }
    let back = decompile(&words, settings).expect("what was compiled is commands");
    assert!(back.notes.is_empty(), "{:?}", back.notes);
    let again = compile(text_of(&back.program).as_bytes(), settings).expect("its text compiles");
    assert!(words.iter().copied().eq(again.program.words()), "{}", text_of(&back.program));
}

fn from_words(words: &[(u32, u32)], settings: &Settings) {
    let Ok(decompiled) = decompile(words, settings) else { return };
    let end = words.iter().position(|&pair| pair == END_MARKER).unwrap_or(words.len());
    let text = text_of(&decompiled.program);
    assert!(text.is_ascii());
    if decompiled.notes.is_empty() {
        let again = compile(text.as_bytes(), settings).expect("without a remark, its text compiles");
        assert!(words[..end].iter().copied().eq(again.program.words()), "{text}");
    }
}
