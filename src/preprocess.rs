//! Turns program files into lines for the board (layer 1).
//!
//! The host resolves comments, names and includes; the board knows none of them. `;` and `//` start a comment; `/*` and
//! `*/` enclose a comment, also over several lines. The directives are `#include "FILE"` (relative to the including
//! file; the quotes may be missing), `#define NAME text`, `#undef NAME`, `#ifdef NAME`, `#ifndef NAME`, `#else` and
//! `#endif`, each alone on its line, in upper or lower case. The host replaces a defined name wherever it is a whole
//! word, also in the text of other names. After `$`, hex digits may follow the name: with `#define BASE 30`, `$BASE10`
//! is `$3010`; no command of a board looks like that, and files of sites build addresses so. Names are case-sensitive.
//! Text in double quotes never changes.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use crate::format::file_text;
use crate::protocol::check_line;

/// The most files that include each other.
const DEPTH_MAX: usize = 16;
/// The most names that refer to each other.
const ROUNDS_MAX: usize = 32;
/// The longest line after names are replaced.
const TEXT_MAX: usize = 4096;
/// The most included files, repeats counted, and the most bytes in them.
const INCLUDES_MAX: usize = 1000;
const BYTES_MAX: usize = 64 << 20;

/// The file's name in messages; `-` is stdin.
pub fn shown(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    if path == Path::new("-") { "stdin".to_owned() } else { path.display().to_string() }
}

/// A place in a file.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The file, as the user wrote it.
    pub file: String,
    /// The line, from 1. 0 means the whole file.
    pub line: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str(&self.file),
            line => write!(f, "{}:{line}", self.file),
        }
    }
}

/// A line for the board, with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceLine {
    /// The line's place.
    pub place: Place,
    /// The line with its names replaced.
    pub text: String,
}

/// A mistake in a file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {what}")]
pub struct Mistake {
    /// The mistake's place.
    pub place: Place,
    /// The mistake.
    pub what: String,
}

/// Reads a file. Tests replace the file system.
pub type Reader<'a> = &'a dyn Fn(&Path) -> Result<Vec<u8>, String>;

/// The lines of the files in order. Names defined in one file hold in the next files too.
///
/// # Errors
/// All mistakes, in order. A file that cannot be read is one mistake, at the line that includes it.
pub fn preprocess(files: &[PathBuf], read: Reader<'_>) -> Result<Vec<SourceLine>, Vec<Mistake>> {
    let mut source = Preprocessor {
        read,
        names: BTreeMap::new(),
        open: Vec::new(),
        included: 0,
        bytes: 0,
        lines: Vec::new(),
        mistakes: Vec::new(),
    };
    for file in files {
        match read(file) {
            Ok(bytes) => source.file(file, &bytes),
            Err(what) => {
                let place = Place { file: shown(file), line: 0 };
                source.mistakes.push(Mistake { place, what });
            }
        }
    }
    if source.mistakes.is_empty() { Ok(source.lines) } else { Err(source.mistakes) }
}

struct Preprocessor<'a> {
    read: Reader<'a>,
    names: BTreeMap<String, String>,
    /// The files being read, the outermost first.
    open: Vec<PathBuf>,
    /// The number of includes so far, and their bytes.
    included: usize,
    bytes: usize,
    lines: Vec<SourceLine>,
    mistakes: Vec<Mistake>,
}

/// One `#ifdef`.
struct Condition {
    place: Place,
    /// Whether the host sends its lines.
    holds: bool,
    /// Whether all outer conditions hold.
    around: bool,
    has_else: bool,
}

impl Preprocessor<'_> {
    fn file(&mut self, path: &Path, bytes: &[u8]) {
        // Comments may have bytes other than UTF-8. The check of the line refuses them elsewhere.
        let text = match file_text::read(bytes) {
            Ok(text) => text,
            Err(reason) => {
                let place = Place { file: shown(path), line: 0 };
                return self.mistakes.push(Mistake { place, what: reason.to_string() });
            }
        };
        self.open.push(path.to_owned());
        let mut conditions = Vec::new();
        let mut comment = None;
        for (line, number) in text.lines().zip(1..) {
            let place = Place { file: shown(path), line: number };
            let line = without_comments(line, &place, &mut comment);
            if let Err(what) = self.line(path, &place, &line, &mut conditions) {
                self.mistakes.push(Mistake { place, what });
            }
        }
        self.mistakes.extend(comment.map(|place| Mistake { place, what: "no */ for this".to_owned() }));
        for condition in conditions {
            self.mistakes.push(Mistake { place: condition.place, what: "no #endif for this".to_owned() });
        }
        self.open.pop();
    }

    fn line(
        &mut self,
        path: &Path,
        place: &Place,
        line: &str,
        conditions: &mut Vec<Condition>,
    ) -> Result<(), String> {
        let text = line.replace('\t', " ");
        let text = text.trim();
        let holds = conditions.last().is_none_or(|condition| condition.holds);
        let Some((directive, rest)) = directive(text) else {
            return if holds && !text.is_empty() { self.command(place, text) } else { Ok(()) };
        };
        match directive {
            Directive::Ifdef | Directive::Ifndef => {
                let known = self.names.contains_key(name(rest)?);
                let holds = holds && known == (directive == Directive::Ifdef);
                let around = conditions.last().is_none_or(|condition| condition.holds);
                conditions.push(Condition { place: place.clone(), holds, around, has_else: false });
            }
            Directive::Else => {
                let condition = conditions.last_mut().ok_or("#else without #ifdef")?;
                if condition.has_else {
                    return Err("a second #else".to_owned());
                }
                condition.has_else = true;
                condition.holds = condition.around && !condition.holds;
            }
            Directive::Endif => {
                conditions.pop().ok_or("#endif without #ifdef")?;
            }
            _ if !holds => {}
            Directive::Define => self.define(rest)?,
            Directive::Undef => {
                self.names.remove(name(rest)?);
            }
            Directive::Include => self.include(path, rest)?,
        }
        Ok(())
    }

    fn command(&mut self, place: &Place, text: &str) -> Result<(), String> {
        let text = self.replace(text)?;
        let text = text.trim();
        if text.is_empty() {
            return Ok(());
        }
        check_line(text)?;
        self.lines.push(SourceLine { place: place.clone(), text: text.to_owned() });
        Ok(())
    }

    fn define(&mut self, rest: &str) -> Result<(), String> {
        let end = rest.find(|c: char| !is_word(c)).unwrap_or(rest.len());
        let (word, text) = rest.split_at(end);
        let word = name(word)?;
        if text.starts_with('(') {
            return Err(format!("{word} has parameters; only plain names can be defined"));
        }
        self.names.insert(word.to_owned(), text.trim().to_owned());
        Ok(())
    }

    fn include(&mut self, path: &Path, rest: &str) -> Result<(), String> {
        let quoted = rest.strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
        let file = quoted.unwrap_or(rest);
        if file.is_empty() || file.contains('"') {
            return Err("write #include \"FILE\"".to_owned());
        }
        let file = path.parent().unwrap_or(Path::new("")).join(file);
        if self.open.contains(&file) {
            return Err(format!("{} includes itself", file.display()));
        }
        if self.open.len() >= DEPTH_MAX {
            return Err(format!("files in files deeper than {DEPTH_MAX}"));
        }
        // Repeated includes can grow exponentially.
        if self.included >= INCLUDES_MAX {
            return Err(format!("files are included more than {INCLUDES_MAX} times"));
        }
        self.included += 1;
        let bytes = (self.read)(&file).map_err(|what| format!("{}: {what}", file.display()))?;
        self.bytes = self.bytes.saturating_add(bytes.len());
        if self.bytes > BYTES_MAX {
            return Err(format!("the files included have more than {} MiB together", BYTES_MAX >> 20));
        }
        self.file(&file, &bytes);
        Ok(())
    }

    /// Replaces defined names in `text` until no name is left.
    fn replace(&self, text: &str) -> Result<String, String> {
        let mut text = text.to_owned();
        for _ in 0..ROUNDS_MAX {
            let Some(replaced) = self.replaced_once(&text) else { return Ok(text) };
            if replaced.len() > TEXT_MAX {
                return Err(format!("the defined names make the line longer than {TEXT_MAX} characters"));
            }
            text = replaced;
        }
        Err("the defined names refer to each other in a circle".to_owned())
    }

    /// `None` if `text` has no defined name.
    fn replaced_once(&self, text: &str) -> Option<String> {
        let mut out = String::new();
        let mut found = false;
        let mut quoted = false;
        let mut rest = text;
        while let Some(c) = rest.chars().next() {
            let length =
                if is_word(c) { rest.find(|c| !is_word(c)).unwrap_or(rest.len()) } else { c.len_utf8() };
            let (part, tail) = rest.split_at(length);
            rest = tail;
            quoted ^= c == '"';
            let name = if out.ends_with('$') { self.name_before_hex(part) } else { part };
            match self.names.get(name).filter(|_| !quoted) {
                Some(text) => {
                    found = true;
                    out.push_str(text);
                    out.push_str(&part[name.len()..]);
                }
                None => out.push_str(part),
            }
            // Stop early: a long text may be repeated a thousand times.
            if found && out.len() > TEXT_MAX {
                break;
            }
        }
        found.then_some(out)
    }

    /// The longest defined name at the start of `word` after a `$`, if only hex digits follow the name. A number is no
    /// name.
    fn name_before_hex<'w>(&self, word: &'w str) -> &'w str {
        let is_hex = |text: &str| text.chars().all(|c| c.is_ascii_hexdigit());
        if is_hex(word) || self.names.contains_key(word) {
            return word;
        }
        // A character that belongs to no word may take several bytes.
        let starts = word.char_indices().rev().map(|(at, _)| word.split_at(at));
        starts
            .filter(|(name, rest)| self.names.contains_key(*name) && is_hex(rest))
            .map(|(name, _)| name)
            .next()
            .unwrap_or(word)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Directive {
    Include,
    Define,
    Undef,
    Ifdef,
    Ifndef,
    Else,
    Endif,
}

/// The directive in `text`, and the rest of the line. Any other word after `#` addresses a motor.
fn directive(text: &str) -> Option<(Directive, &str)> {
    let text = text.strip_prefix('#')?.trim_start();
    let end = text.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (word, rest) = text.split_at(end);
    let directive = match word.to_ascii_lowercase().as_str() {
        "include" => Directive::Include,
        "define" => Directive::Define,
        "undef" => Directive::Undef,
        "ifdef" => Directive::Ifdef,
        "ifndef" => Directive::Ifndef,
        "else" => Directive::Else,
        "endif" => Directive::Endif,
        _ => return None,
    };
    Some((directive, rest.trim()))
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// Checks that `text` is a valid name.
fn name(text: &str) -> Result<&str, String> {
    let starts = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    if starts && text.chars().all(is_word) { Ok(text) } else { Err(format!("{text:?} is not a name")) }
}

/// `line` without its comments. `open` is the begin of a comment that goes over several lines.
fn without_comments(line: &str, place: &Place, open: &mut Option<Place>) -> String {
    let mut out = String::new();
    let mut quoted = false;
    let mut rest = line;
    loop {
        if open.is_some() {
            let Some((_, behind)) = rest.split_once("*/") else { return out };
            rest = behind;
            *open = None;
            out.push(' ');
        }
        let Some(c) = rest.chars().next() else { return out };
        if !quoted && (c == ';' || rest.starts_with("//")) {
            return out;
        }
        if !quoted && let Some(behind) = rest.strip_prefix("/*") {
            rest = behind;
            *open = Some(place.clone());
            continue;
        }
        quoted ^= c == '"';
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(files: &[(&str, &str)]) -> Result<Vec<String>, Vec<String>> {
        let read = |path: &Path| {
            let found = files.iter().find(|(name, _)| Path::new(name) == path);
            found.map(|(_, text)| text.as_bytes().to_vec()).ok_or_else(|| "not there".to_owned())
        };
        match preprocess(&[PathBuf::from(files[0].0)], &read) {
            Ok(lines) => Ok(lines.iter().map(|line| format!("{}: {}", line.place, line.text)).collect()),
            Err(mistakes) => Err(mistakes.iter().map(Mistake::to_string).collect()),
        }
    }

    fn lines(text: &str) -> Vec<String> {
        run(&[("f", text)]).unwrap()
    }

    #[test]
    fn comments_and_blank_lines_go() {
        let text = "; title\r\n\r\nI100=1 ; on\n\tP1=2//two\nSEND\"a;b//c\" ; said\n/\nP2=P3/2\n";
        assert_eq!(
            lines(text),
            ["f:3: I100=1", "f:4: P1=2", "f:5: SEND\"a;b//c\"", "f:6: /", "f:7: P2=P3/2"]
        );
    }

    #[test]
    fn comments_go_over_lines() {
        let text =
            "/* title ; one\n\"two\" P9=9 */ P1=1 /* on */ P2=2\nSEND\"/* no */\"\nP3=4/*x*//2//*\nP4=1\n";
        assert_eq!(lines(text), ["f:2: P1=1   P2=2", "f:3: SEND\"/* no */\"", "f:4: P3=4 /2", "f:5: P4=1"]);
        assert_eq!(run(&[("f", "P1=1\nP2=2 /* never\nP3=3\n")]).unwrap_err(), ["f:2: no */ for this"]);
    }

    #[test]
    fn a_name_behind_a_dollar_may_have_digits_behind_it() {
        let text = "#define Base B8\n#define Store Base3\n#define B 7\n#define Based 10\nM1->X:$Base30,0,4\n\
                    M2->L:$Based0\nM3->L:$Basement\nP1=$B0\nM4->L:$Base\nBase30=1\n#define Next BaseC\nM5->L:$Next\n";
        assert_eq!(
            lines(text),
            [
                "f:5: M1->X:$B830,0,4",
                "f:6: M2->L:$100",
                "f:7: M3->L:$Basement",
                "f:8: P1=$B0",
                "f:9: M4->L:$B8",
                "f:10: Base30=1",
                "f:12: M5->L:$B8C"
            ]
        );
    }

    #[test]
    fn an_include_needs_no_quotes() {
        let files =
            [("dir/main.pmc", "#include a b.pmc ; beside it\nP1=A\n"), ("dir/a b.pmc", "#define A 7\n")];
        assert_eq!(run(&files).unwrap(), ["dir/main.pmc:2: P1=7"]);
        assert_eq!(run(&[("f", "#include \"a\n")]).unwrap_err(), ["f:1: write #include \"FILE\""]);
    }

    #[test]
    fn names_are_replaced_as_whole_words_and_in_each_other() {
        let text = "#define SPEED I122\n#define FAST (2*BASE)\n#DEFINE BASE 16 ; counts\n#define GONE\n\
                    SPEED=FAST\nSPEEDY=1\nSEND\"SPEED\"\nspeed\nGONE\n#1J+GONE\n#undef SPEED\nSPEED\n";
        assert_eq!(
            lines(text),
            [
                "f:5: I122=(2*16)",
                "f:6: SPEEDY=1",
                "f:7: SEND\"SPEED\"",
                "f:8: speed",
                "f:10: #1J+",
                "f:12: SPEED"
            ]
        );
    }

    #[test]
    fn files_are_included_where_they_are_named() {
        let files = [
            ("dir/main.pmc", "P1=1\n#include \"inc/a.pmc\"\nP1=A\n"),
            ("dir/inc/a.pmc", "#include \"b.pmc\" ; beside it\nP2=1"),
            ("dir/inc/b.pmc", "#define A 7\n"),
        ];
        assert_eq!(
            run(&files).unwrap(),
            ["dir/main.pmc:1: P1=1", "dir/inc/a.pmc:2: P2=1", "dir/main.pmc:3: P1=7"]
        );
    }

    #[test]
    fn conditions_choose() {
        let text = "#define A\n#ifdef A\nP1=1\n#ifndef A\nP2=1\n#else\nP3=1\n#endif\n#else\nP4=1\n#ifdef A\nP5=1\n\
                    #else\nP6=1\n#endif\n#include \"nowhere\"\n#endif\nP7=1";
        assert_eq!(lines(text), ["f:3: P1=1", "f:7: P3=1", "f:18: P7=1"]);
    }

    #[test]
    fn everything_wrong_is_told_with_its_place() {
        let long = "P".repeat(201);
        let text = format!(
            "#include\n#include \"gone\"\n#include \"f\"\n#define 1A 2\n#define F(x) x\n#else\n#endif\n\
             #define A B\n#define B A\nP1=A\n{long}\nP1=\u{b}5\nP1=\u{fc}\n#ifdef A\n"
        );
        let mistakes = run(&[("f", &text)]).unwrap_err();
        let expected = [
            "f:1: write #include \"FILE\"",
            "f:2: gone: not there",
            "f:3: f includes itself",
            "f:4: \"1A\" is not a name",
            "f:5: F has parameters",
            "f:6: #else without #ifdef",
            "f:7: #endif without #ifdef",
            "f:10: the defined names refer to each other",
            "f:11: the line has 201 characters",
            "f:12: character '\\u{b}' at position 3",
            "f:13: character",
            "f:14: no #endif for this",
        ];
        assert_eq!(mistakes.len(), expected.len(), "{mistakes:?}");
        for (mistake, expected) in mistakes.iter().zip(expected) {
            assert!(mistake.starts_with(expected), "{mistake}: {expected}");
        }
        let doubling: String = (0..20).map(|n| format!("#define A{n} A{} A{}\n", n + 1, n + 1)).collect();
        assert!(run(&[("f", &format!("{doubling}A0\n"))]).unwrap_err()[0].contains("longer than 4096"));
    }

    #[test]
    fn small_files_never_grow_without_measure() {
        // 256 ways through four files, then 65536 through eight.
        let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
        let include = |name: &&str| format!("#include \"{name}\"\n").repeat(4);
        let texts: Vec<String> = names.iter().skip(1).map(include).chain(["P1=1".to_owned()]).collect();
        let files: Vec<(&str, &str)> = names.into_iter().zip(texts.iter().map(String::as_str)).collect();
        assert_eq!(run(&files[4..]).unwrap().len(), 256);
        let mistakes = run(&files).unwrap_err();
        assert!(mistakes[0].contains("included more than 1000 times"), "{}", mistakes[0]);
        assert!(mistakes.len() < 4000);
        let large = format!(";{}", "-".repeat(30 << 20));
        let mistakes =
            run(&[("a", "#include \"b\"\n#include \"b\"\n#include \"b\"\n"), ("b", &large)]).unwrap_err();
        assert_eq!(mistakes, ["a:3: the files included have more than 64 MiB together"]);
        // A name of a megabyte, a thousand times in a line, would be a gigabyte.
        let text = format!("#define A {}\n{}\n", "x".repeat(1 << 20), "A ".repeat(1000));
        let source = Preprocessor {
            read: &|_: &Path| Err(String::new()),
            names: BTreeMap::from([("A".to_owned(), "x".repeat(1 << 20))]),
            open: Vec::new(),
            included: 0,
            bytes: 0,
            lines: Vec::new(),
            mistakes: Vec::new(),
        };
        assert!(source.replaced_once(&"A ".repeat(1000)).unwrap().len() < 2 << 20);
        assert!(run(&[("f", &text)]).unwrap_err()[0].contains("longer than 4096"));
    }

    #[test]
    fn what_is_no_program_file_is_refused_with_its_place() {
        let mistakes = run(&[("f", "P1=1\nCMD\"$\u{e9}\"\n#define B 1\nM1->X:$\u{fffd}B,0\n")]).unwrap_err();
        let places: Vec<&str> = mistakes.iter().filter_map(|mistake| mistake.get(..4)).collect();
        assert_eq!(places, ["f:2:", "f:4:"], "{mistakes:?}");
    }

    proptest::proptest! {
        #[test]
        fn no_text_can_harm(text in "(#define|#include|#ifdef|#endif|\"|;|//|[$]|A|B| |\n|\u{e9}|\u{fffd})*") {
            let _ = run(&[("f", &text)]);
        }
    }
}
