//! Decides whether a file can be a PMAC file at all. The board would carry out a letter to another program word by
//! word: the first line of "A note to the operators" aborts.
//!
//! The check looks at the begin of each line. It refuses a file when most of its lines begin with no word that PMAC
//! knows, so that a few lines of another firmware keep no file of a real machine out.

use crate::preprocess::{Mistake, SourceLine};

/// Words of commands and of programs, long and short (Software Reference, command lists).
const WORDS: &str = "ABS ADDRESS ADIS ADR AROT BLOCKSTART BLOCKSTOP BSTART BSTOP CALL CC CCR CHECKSUM CHKS CID CIR CIRCLE CLEAR CLOSE CLR \
    CLS CMD COMMAND CPU DATE DEF DEFINE DEL DELAY DELETE DIS DISABLE DISP DISPLAY DISPLC DISPLCC DLY DWE DWELL ELSE ENA \
    ENABLE ENAPLC ENAPLCC ENDG ENDGATHER ENDI ENDIF ENDW ENDWHILE FRAX FREAD GAT GATHER GOSUB GOTO HM HMZ HOME HOMEZ IDIS IF INC \
    IROT LEARN LIN LINEAR LIST LOCK MACRO NOFRAX NORM NORMAL NRM OPEN MI MS PASSWORD PAUSE PC PE PMATCH PR PRELUDE PSET PVT RAPID READ RESUME RET \
    RETURN RHL RHX RHY RL RPD RX RY SAVE SEND SENDP SENDR SENDS SETPHASE SIZE SPLINE STOP STN TA TINIT TM TRIGGER TS TSEL TSELECT TX TY TYPE TZ \
    UNDEF UNDEFINE UNLOCK VER VERSION WAIT WHILE WL WP WX WY";

/// Refuses lines most of which PMAC does not know.
///
/// # Errors
/// The first line that PMAC does not know.
pub fn check(lines: &[SourceLine]) -> Result<(), Mistake> {
    let mut strange = lines.iter().filter(|line| !begins_as_pmac(&line.text)).peekable();
    let Some(first) = strange.peek().map(|line| (*line).clone()) else { return Ok(()) };
    if 2 * strange.count() <= lines.len() {
        return Ok(());
    }
    Err(Mistake {
        place: first.place,
        what: format!(
            "{:?} is no command, as most lines of this file; nothing was sent. Is it a program file? --force sends it all the same",
            first.text.chars().take(40).collect::<String>()
        ),
    })
}

/// Whether `text` begins with something that PMAC knows: a word, a variable or an axis with a number, an address, a
/// number.
fn begins_as_pmac(text: &str) -> bool {
    let text = text.trim_start();
    let Some(first) = text.chars().next() else { return true };
    let behind = text[first.len_utf8()..].trim_start();
    match first {
        '#' | '&' | '%' | '@' => {
            behind.is_empty() || behind.starts_with(|c: char| c.is_ascii_hexdigit() || "#&@+-".contains(c))
        }
        '$' | '?' | '<' | '>' | '/' | '\\' | '!' => true,
        '+' | '-' | '.' => behind.starts_with(|c: char| c.is_ascii_digit() || "$.".contains(c)),
        '0'..='9' => !behind
            .trim_start_matches(|c: char| c.is_ascii_digit() || ".,".contains(c))
            .starts_with([')', ':']),
        'a'..='z' | 'A'..='Z' => {
            let end = text.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(text.len());
            letters(&text[..end].to_ascii_uppercase(), text[end..].trim_start())
        }
        _ => false,
    }
}

/// Whether a run of letters can begin a line, with `behind` after it. PMAC needs no blanks, so the run may be several
/// words, and end with a letter that has a number.
fn letters(run: &str, behind: &str) -> bool {
    let is_word = |run: &str| WORDS.split_ascii_whitespace().any(|word| word == run);
    if is_word(run) {
        return true;
    }
    if run.len() > 1 {
        let splits = (1..run.len()).rev().map(|at| run.split_at(at));
        return splits.into_iter().any(|(begin, rest)| is_word(begin) && letters(rest, behind));
    }
    // One letter alone is a command of the motor or coordinate system, with a number an axis, a variable, a label.
    behind.is_empty()
        || behind.starts_with(|c: char| c.is_ascii_digit() || "(=+-.,$/:^*<>#&?!;\"".contains(c))
        || {
            let next = behind.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(behind.len());
            next == 1 && begins_as_pmac(behind)
        }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::preprocess::preprocess;

    fn checked(text: &str) -> Result<(), Mistake> {
        let lines = preprocess(&["f".into()], &|_: &Path| Ok(text.as_bytes().to_vec())).unwrap();
        check(&lines)
    }

    #[test]
    fn what_is_no_program_file_is_refused() {
        for text in [
            "Dear colleagues,\nplease find the new limits below.\nA. Smith\n",
            "A note to the operators:\nhome the telescope first.\nThen park it.\n",
            "[package]\nname = \"pmac\"\nversion = \"1\"\n",
            "{\n  \"motors\": 8\n}\n",
            "int main() {\nreturn 0;\n}\n",
            "1) switch on\n2) wait\n3) go home\n",
            "#!/bin/sh\necho hello\nexit 0\n",
        ] {
            let mistake = checked(text).unwrap_err();
            assert!(mistake.what.contains("--force"), "{text}: {mistake}");
        }
        assert_eq!(checked("Dear colleagues,\nplease\n").unwrap_err().place.line, 1);
    }

    #[test]
    fn program_files_are_taken() {
        for text in [
            "",
            "CLOSE\nDELETE GATHER\nOPEN PROG 5 CLEAR\nLINEAR INC TM500\nX1000Y-20\nDWELL100\nCLOSE\n",
            "openplc3clear\nif(m11=1and p5>3)\np1=p1+1\nendif\nclose\n&1b5r\n",
            "#1->1000X\n&2#3->5A+X\nI122=32\ni 58 = 1\nM102->*\nM1..8=0\nM101->X:$C001,24,S\nP(Q1)=5\n",
            "DEFINE COMP 100,100000\n342\n-15\n$1F\n1,2,3\n.5\n",
            "N10 G1 X10 F500\nG00X5\nM03 S1000\nT1\nX 10 Y 20\nHOME1,2\nHM1..4\nCIRCLE1 X1 I2\nCC1 X5\n",
            "SEND\"HELLO THERE\"\nCMD^A\nENAPLC3\nDISPLC1..5\nRHX$1000,4\nWY$C003,1\nMI7=3\nMS0,MI910=7\n$$$\nSAVE\n",
            "OPEN PLCC 2 CLEAR\nREAD(A,B)\nGOTO1000\nCALL 10.5 X3\nPVT200 X5:10\nRAPID X5^0.1\nTX1 TY2 NX0\n",
            "J+\nJ/ K\nA\nS\nR\n%50\n?\n???\n#5?\n@0\n",
        ] {
            assert_eq!(checked(text), Ok(()), "{text}");
        }
    }

    #[test]
    fn every_on_line_command_begins_as_pmac() {
        let table = include_str!("../../../tests/data/online_commands.tsv");
        // Wrong on purpose.
        let foreign = ["UNITS", "JOG"];
        for line in table.lines().filter(|line| !line.starts_with("# ") && !line.is_empty()) {
            let command = line.split('\t').next().unwrap();
            assert!(foreign.contains(&command) || begins_as_pmac(command), "{command}");
        }
    }
}
