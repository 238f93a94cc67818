//! Command lines of a client.
//!
//! I3, I4 and I6 are the client's own and do not reach the board. Control characters go before the line that holds
//! them, because a board takes them at once. A line without an address means this client's last address, whatever other
//! clients have addressed since. A line too long for the board goes in parts if it only asks, sets variables and writes
//! memory; the gateway refuses other long lines. Questions for many variables go in parts, too, so that no client's
//! stop waits for the whole question.

use pmac_dpram::language::lexer::{Does, Kind, Needs, Token, tokens};
use pmac_dpram::language::number::Numbers;
use pmac_dpram::language::password::without_password;
use pmac_dpram::language::{Effect, LINE_MAX, Meaning};

use crate::addressed::{Addressed, Doubt, uses_of};
use crate::board::{self, Failure};
use crate::reply::Handshake;
use crate::session::{READ_ONLY, Session};

/// Variables in one question to the board, and in a client's question at most.
const AT_ONCE: u32 = 50;
const MOST: u32 = 8192;

/// A piece of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    /// Goes to the board.
    Send(String),
    /// A question for I-variables, among them some of the client's own: the first variable and the step between them.
    Own(String, u32, u32),
    /// Sets a variable of the client's own to this value.
    Set(u32, u32),
    /// The gateway's own answer to `VERSION`.
    Version(String),
    /// Sent nowhere: an address without a use behind it, of a client that may only read.
    Nothing,
}

/// The parts of a line that the gateway keeps from the board.
#[derive(Debug, Clone, Copy, Default)]
struct Kept<'a> {
    /// The gateway's own answer to `VERSION`.
    version: Option<&'a str>,
    /// The gateway sends an address only where a question needs it.
    addresses: bool,
}

fn tokens_of(line: &str) -> Vec<Token> {
    tokens(line.as_bytes()).collect()
}

/// Whether `tokens` move or stop something.
fn has_motion(tokens: &[Token]) -> bool {
    tokens.iter().any(|token| matches!(token.kind, Kind::Moves(..) | Kind::Resets))
}

/// Splits `line` into pieces.
fn pieces(
    line: &str,
    tokens: &[Token],
    mut addressed: Addressed,
    kept: Kept<'_>,
) -> Result<Vec<Piece>, Failure> {
    let mut pieces = Vec::new();
    let mut rest = tokens;
    while !rest.is_empty() {
        let own = own_piece(line, rest, kept)?;
        let count = match &own {
            Some(_) => 1,
            None => {
                let goes = |from: &usize| matches!(own_piece(line, &rest[*from..], kept), Ok(None));
                fitting(line, (0..rest.len()).take_while(goes).count(), rest, addressed)?
            }
        };
        let (now, behind) = rest.split_at(count.max(1));
        pieces.push(own.unwrap_or_else(|| {
            // A trailing address goes with the piece that uses it.
            let ends = |token: &Token| !kept.addresses || only_addresses(token).is_none();
            match now.iter().rposition(ends) {
                Some(last) => Piece::Send(text_of(line, &now[..=last], addressed)),
                None => Piece::Nothing,
            }
        }));
        now.iter().for_each(|token| addressed.follow(token));
        rest = behind;
    }
    Ok(pieces)
}

/// The piece for the first of `tokens`, if the board does not get that token as it is.
fn own_piece(line: &str, tokens: &[Token], kept: Kept<'_>) -> Result<Option<Piece>, Failure> {
    let Some((token, behind)) = tokens.split_first() else { return Ok(None) };
    let text = line[token.span.clone()].trim();
    match token.kind {
        Kind::Variables(b'I', numbers, does) if Handshake::has_among(numbers) => {
            let (first, step) = match (numbers, does) {
                (Numbers::One(first), Does::Sets { value: Some(value), .. }) => {
                    return Ok(Some(Piece::Set(first, value)));
                }
                (_, Does::Sets { .. }) => {
                    let why =
                        format!("{text:?}: I3, I4 and I6 are the client's own; set each to a plain number");
                    return Err(Failure::unsent(board::UNKNOWN, why));
                }
                (Numbers::Range(first, _, step), _) => (first, step),
                (Numbers::One(first), _) => (first, 1),
                (Numbers::Unknown, _) => return Ok(None),
            };
            Ok(Some(Piece::Own(text.to_owned(), first, step)))
        }
        Kind::Version => Ok(kept.version.map(|version| Piece::Version(version.to_owned()))),
        _ => Ok(match only_addresses(token) {
            Some(needs) if kept.addresses && uses_of(behind, needs).next().is_none() => Some(Piece::Nothing),
            _ => None,
        }),
    }
}

/// Whether `token` sets variables of the client's own.
fn sets_own(token: &Token) -> bool {
    matches!(token.kind, Kind::Variables(b'I', numbers, Does::Sets { .. }) if Handshake::has_among(numbers))
}

/// The kind of address, if `token` is nothing but an address.
fn only_addresses(token: &Token) -> Option<Needs> {
    match token.kind {
        Kind::Motor(_) => Some(Needs::Motor),
        Kind::System(_) => Some(Needs::System),
        _ => None,
    }
}

/// The text of `tokens` for the board, with the address that they need.
fn text_of(line: &str, tokens: &[Token], addressed: Addressed) -> String {
    let start = tokens.first().map_or(0, |token| token.span.start);
    let end = tokens.last().map_or(0, |token| token.span.end);
    addressed.prefix(tokens) + line[start..end].trim()
}

/// How many of the first `count` tokens go in one piece: all, if the board takes so long a line. Otherwise as many as
/// fit, if each may end its line; the cut stands before an address, if possible.
fn fitting(line: &str, count: usize, tokens: &[Token], addressed: Addressed) -> Result<usize, Failure> {
    let fits = |count: usize| text_of(line, &tokens[..count], addressed).len() <= LINE_MAX;
    if fits(count) {
        return Ok(count);
    }
    let too_long = || {
        let why = format!(
            "the line is longer than the {LINE_MAX} characters that the board takes, and not all of it asks, sets variables or \
             writes memory"
        );
        Failure::unsent(board::NO_ROOM, why)
    };
    if !tokens[..count].iter().all(|token| token.kind.ends_its_line()) {
        return Err(too_long());
    }
    let begins =
        |index: &usize| matches!(tokens[*index].kind, Kind::Motor(_) | Kind::System(_) | Kind::AxisOf(_));
    let most = || (1..count).rev().find(|count| fits(*count));
    (1..count).rev().filter(begins).find(|count| fits(*count)).or_else(most).ok_or_else(too_long)
}

/// `line` as questions for at most [`AT_ONCE`] variables each; `None` if no question is longer or the line does not
/// only ask. The board takes seconds for thousands of variables, and a stop by command line waits for the running line.
fn short_questions(line: &str, tokens: &[Token]) -> Option<Vec<String>> {
    if !tokens.iter().all(|token| token.kind.only_asks()) {
        return None;
    }
    let texts = || tokens.iter().map(|token| line[token.span.clone()].trim());
    texts().any(|text| ranges(text).is_some()).then(|| {
        let short = |text: &str| ranges(text).unwrap_or_else(|| vec![text.to_owned()]);
        texts().flat_map(short).collect()
    })
}

/// `line` with each memory write that is too long for the board split into shorter writes; `None` without such a write.
fn short_writes(line: &str, tokens: &[Token]) -> Option<String> {
    let is_long = |token: &Token| token.kind == Kind::WritesMemory && token.span.len() > LINE_MAX;
    if !tokens.iter().any(is_long) {
        return None;
    }
    let commands = tokens.iter().flat_map(|token| {
        let text = line[token.span.clone()].trim();
        let short = is_long(token).then(|| rows(text)).flatten();
        short.unwrap_or_else(|| vec![text.to_owned()])
    });
    Some(commands.collect::<Vec<_>>().join(" "))
}

/// `WL:$770,1,2,3` as `WL:$770,1,2` and `WL:$772,3`, each short enough for the board: each value has an address of its
/// own.
fn rows(text: &str) -> Option<Vec<String>> {
    let text: String = text.split_whitespace().collect();
    let (head, values) = text.split_once(',')?;
    let digits = head.rfind(|c: char| !c.is_ascii_hexdigit()).map_or(0, |at| at + 1);
    let (space, digits) = head.split_at(digits);
    let (radix, width) = if space.ends_with('$') { (16, digits.len()) } else { (10, 0) };
    let mut address = u32::from_str_radix(digits, radix).ok()?;
    let mut rows: Vec<String> = Vec::new();
    for value in values.split(',') {
        match rows.last_mut() {
            Some(row) if row.len() + 1 + value.len() <= LINE_MAX => {
                row.push(',');
                row.push_str(value);
            }
            _ if radix == 16 => rows.push(format!("{space}{address:0width$X},{value}")),
            _ => rows.push(format!("{space}{address},{value}")),
        }
        address = address.checked_add(1)?;
    }
    Some(rows)
}

/// `I0..8191` as `I0..49`, `I50..99` and so on; `M0,100,2->` as `M0,50,2->`, `M100,50,2->`. `None` for a shorter range
/// or any other text.
fn ranges(text: &str) -> Option<Vec<String>> {
    let kind = text.get(..1).filter(|kind| "IPQM".contains(&kind.to_ascii_uppercase()))?;
    let (numbers, arrow) = match text[1..].split_once("->") {
        Some((numbers, "")) => (numbers, "->"),
        Some(_) => return None,
        None => (&text[1..], ""),
    };
    let numbers: String = numbers.split_whitespace().collect();
    let (first, count, step): (u32, u32, Option<u32>) = match numbers.split_once("..") {
        Some((first, last)) => {
            let first = first.parse().ok()?;
            (first, last.parse::<u32>().ok()?.checked_sub(first)?.checked_add(1)?, None)
        }
        None => {
            let mut parts = numbers.splitn(3, ',').map(str::parse);
            let (first, count) = (parts.next()?.ok()?, parts.next()?.ok()?);
            (first, count, Some(parts.next().unwrap_or(Ok(1)).ok()?))
        }
    };
    let begins = (0..count).step_by(AT_ONCE as usize);
    let one = |begin: u32| {
        let (from, many) =
            (begin.checked_mul(step.unwrap_or(1))?.checked_add(first)?, AT_ONCE.min(count - begin));
        Some(match step {
            Some(step) => format!("{kind}{from},{many},{step}{arrow}"),
            None => format!("{kind}{from}..{}{arrow}", from + many - 1),
        })
    };
    if count > AT_ONCE && count <= MOST { begins.map(one).collect() } else { None }
}

impl Session {
    /// Carries out the lines of `text`, and adds their replies for the client.
    pub(crate) fn text(&mut self, text: &[u8]) -> Result<(), Failure> {
        // "The string NULL terminated"; the gateway also accepts a line terminator.
        let text = text.split(|byte| *byte == 0).next().unwrap_or_default();
        let text = text.strip_suffix(b"\n").unwrap_or(text);
        let text = text.strip_suffix(b"\r").unwrap_or(text);
        for line in text.split(|byte| matches!(byte, b'\r' | b'\n')) {
            match self.one_text(line) {
                Err(Failure::Refused { code, lines, why, .. }) => self.refused(code, &lines, why.as_deref()),
                // With no reply waiting, the client fetches a single 0.
                Err(Failure::Unanswered(why)) => self.tell("no answer", &why),
                done => done?,
            }
        }
        Ok(())
    }

    /// Carries out one line and the control characters in it.
    pub(crate) fn one_text(&mut self, text: &[u8]) -> Result<(), Failure> {
        if self.pending.is_full() {
            return Err(Failure::Gone("the client does not fetch what he is answered".to_owned()));
        }
        let mut line = String::with_capacity(text.len());
        let mut controls = Vec::new();
        for byte in text {
            match byte {
                b'\t' => line.push(' '),
                1..=31 => controls.push(*byte),
                b' '..=b'~' => line.push(char::from(*byte)),
                _ => {
                    let why = format!("the character ${byte:02X} is no ASCII");
                    return Err(Failure::unsent(board::ILLEGAL, why));
                }
            }
        }
        for character in controls {
            let lines = self.control(character)?;
            self.pending.lines(&lines, self.port.handshake);
        }
        self.look_after_jogs()?;
        let line = line.trim();
        if line.is_empty() {
            self.pending.end(self.port.handshake);
            return Ok(());
        }
        let meaning = Meaning::of(line);
        let effect = meaning.buffer;
        // A line that closes the lost buffer or opens another one is not meant for the lost buffer.
        self.port.has_lost_buffer &= effect.is_none();
        if self.port.has_lost_buffer {
            let why =
                "the program buffer that was open is closed; nothing is sent before CLOSE, or another OPEN";
            return Err(Failure::unsent(board::NO_BUFFER, why));
        }
        let had_buffer = self.board.is_in_buffer();
        let done = self.line(line, &meaning);
        let has_lost = had_buffer && !self.board.is_in_buffer() && done.is_err();
        self.port.has_lost_buffer = has_lost && effect != Some(Effect::Closes);
        done?;
        self.pending.end(self.port.handshake);
        Ok(())
    }

    fn line(&mut self, line: &str, meaning: &Meaning) -> Result<(), Failure> {
        if self.board.is_in_buffer() || meaning.opens() {
            return self.whole_line(line, meaning);
        }
        let tokens = tokens_of(line);
        let is_harmless = |token: &Token| token.kind.only_asks() || sets_own(token);
        if self.rules.read_only && !tokens.iter().all(is_harmless) {
            return Err(Failure::unsent(board::NO_RIGHT, READ_ONLY));
        }
        let sent = match (short_questions(line, &tokens), short_writes(line, &tokens)) {
            (Some(questions), _) => {
                questions.iter().try_for_each(|question| self.commands(question, &tokens_of(question)))
            }
            (None, Some(writes)) => self.commands(&writes, &tokens_of(&writes)),
            (None, None) => self.commands(line, &tokens),
        };
        if has_motion(&tokens) || meaning.lets_programs_move {
            self.log_motion(line, &sent);
        }
        sent
    }

    /// Carries out a line for no program buffer.
    fn commands(&mut self, line: &str, tokens: &[Token]) -> Result<(), Failure> {
        let mut addressed = self.port.addressed;
        let doubt = match has_motion(tokens) {
            _ if self.says_whom => Doubt::ALL,
            true => self.doubt,
            false => Doubt::default(),
        };
        if !addressed.suffices(tokens, doubt) {
            let why = format!("{line:?} does not say which motor or coordinate system it means; address one");
            return Err(Failure::unsent(board::UNKNOWN, why));
        }
        if addressed.motor.is_none() && !self.rules.keep_jogs && Meaning::of(line).possible_jogs().unnamed {
            // The line that ends the jog has to name the motor.
            addressed.motor = self.board.send("#")?.first().and_then(|answer| answer.trim().parse().ok());
        }
        let kept = Kept { version: self.rules.version.as_deref(), addresses: self.rules.read_only };
        let pieces = pieces(line, tokens, addressed, kept)?;
        let mut handshake = self.port.handshake;
        for piece in &pieces {
            // Checked before anything is sent: nothing of a refused line takes effect.
            if let Piece::Set(number, value) = piece
                && !handshake.set(*number, *value)
            {
                let why = format!(
                    "I{number}={value}: a client's own I3 and I6 are 0 to 3; his I4 is 0, as there are no check sums here"
                );
                return Err(Failure::unsent(board::UNKNOWN, why));
            }
        }
        let before = std::mem::replace(&mut self.port.addressed, addressed);
        self.port.addressed.follow_all(tokens);
        for (index, piece) in pieces.iter().enumerate() {
            let lines = self.piece(piece).map_err(|failure| {
                let failure = known_only_in_part(failure, piece, index);
                self.fall_back(before, &failure);
                failure
            })?;
            self.pending.lines(&lines, self.port.handshake);
        }
        Ok(())
    }

    /// Falls back after a failed line; `before` is the address before it. Unless nothing was sent, the gateway does not
    /// know which of the line's addresses the board has taken: the next line that moves or stops something must name
    /// its motor or system.
    fn fall_back(&mut self, before: Addressed, failure: &Failure) {
        match failure {
            Failure::Unanswered(_) => {}
            Failure::Refused { is_sent: false, .. } => self.port.addressed = before,
            Failure::Refused { .. } | Failure::Gone(_) => {
                self.doubt.motor |= self.port.addressed.motor != before.motor;
                self.doubt.system |= self.port.addressed.system != before.system;
                self.port.addressed = self.port.addressed.common(before);
            }
        }
    }

    /// Sends a line unchanged: it opens a program buffer, or enters one.
    fn whole_line(&mut self, line: &str, meaning: &Meaning) -> Result<(), Failure> {
        if self.rules.read_only {
            return Err(Failure::unsent(board::NO_RIGHT, READ_ONLY));
        }
        if line.len() > LINE_MAX {
            let why = format!("a program line has at most {LINE_MAX} characters");
            return Err(Failure::unsent(board::NO_ROOM, why));
        }
        let sent = self.board.send(line);
        if !meaning.moves.is_empty() || meaning.lets_programs_move {
            self.log_motion(line, &sent);
        }
        self.pending.lines(&sent?, self.port.handshake);
        Ok(())
    }

    fn piece(&mut self, piece: &Piece) -> Result<Vec<String>, Failure> {
        match piece {
            Piece::Send(line) => self.board.send(line),
            Piece::Version(version) => Ok(vec![version.clone()]),
            Piece::Nothing => Ok(Vec::new()),
            Piece::Set(number, value) => {
                self.port.handshake.set(*number, *value);
                Ok(Vec::new())
            }
            Piece::Own(question, first, step) => {
                let mut lines = self.board.send(question)?;
                for (number, line) in (*first..).step_by((*step).max(1) as usize).zip(&mut lines) {
                    if let Some(value) = self.port.handshake.get(number) {
                        // Keeps the board's form before the value, "I3=" or "$" as its I9 has it.
                        let kept = line.rfind(['=', '$']).map_or(0, |at| at + 1);
                        line.truncate(kept);
                        line.push_str(&value.to_string());
                    }
                }
                Ok(lines)
            }
        }
    }
}

/// The failure of `piece` after `done` pieces of its line. Not sending a later piece is no refusal of the board: the
/// client sees the replies up to there, and the log tells how far the line has come.
fn known_only_in_part(failure: Failure, piece: &Piece, done: usize) -> Failure {
    match failure {
        Failure::Refused { code, lines, why, .. } if done > 0 => {
            let why = why.unwrap_or_else(|| match piece {
                Piece::Send(text) | Piece::Own(text, ..) => {
                    format!("the board refused {:?}", without_password(text))
                }
                _ => "the board refused it".to_owned(),
            });
            let why = Some(format!("{why}; what stands before it in its line is done"));
            Failure::Refused { code, lines, why, is_sent: true }
        }
        failure => failure,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(line: &str, motor: Option<u32>, system: Option<u32>) -> Result<Vec<Piece>, Failure> {
        let kept = Kept { version: Some("1.94"), addresses: false };
        pieces(line, &tokens_of(line), Addressed { motor, system }, kept)
    }

    fn send(line: &str) -> Piece {
        Piece::Send(line.to_owned())
    }

    #[test]
    fn questions_for_many_variables_go_in_parts() {
        let of = |line: &str| short_questions(line, &tokens_of(line));
        assert_eq!(of("i0..119").unwrap(), ["i0..49", "i50..99", "i100..119"]);
        assert_eq!(of("M10..70->").unwrap(), ["M10..59->", "M60..70->"]);
        assert_eq!(of("P100,60,2").unwrap(), ["P100,50,2", "P200,10,2"]);
        assert_eq!(of("P0,60").unwrap(), ["P0,50,1", "P50,10,1"]);
        assert_eq!(of("#1P &2 Q0..50").unwrap(), ["#1", "P", "&2", "Q0..49", "Q50..50"]);
        assert_eq!(of("I0..8191").map(|parts| parts.len()), Some(164));
        for line in
            ["I0..49", "I0", "P1", "#1P", "I0..8191=0", "I0..119 #1J+", "I9..0", "LIST PROG 1", "I0..99999"]
        {
            assert_eq!(of(line), None, "{line}");
        }
    }

    #[test]
    fn what_is_the_clients_own_does_not_go_to_the_board() {
        let own = |text: &str, first| Piece::Own(text.to_owned(), first, 1);
        assert_eq!(
            of("i6=1 i3=2 ver", None, None).unwrap(),
            [Piece::Set(6, 1), Piece::Set(3, 2), Piece::Version("1.94".to_owned())]
        );
        assert_eq!(of("p1 i3 p2 m1", None, None).unwrap(), [send("p1"), own("i3", 3), send("p2 m1")]);
        assert_eq!(of("i0..9", None, None).unwrap(), [own("i0..9", 0)]);
        assert!(matches!(of("i3=p1", None, None), Err(Failure::Refused { code: board::UNKNOWN, .. })));
        assert!(matches!(of("i0..99=0", None, None), Err(Failure::Refused { code: board::UNKNOWN, .. })));
    }

    #[test]
    fn a_line_means_whom_its_client_addressed() {
        assert_eq!(of("J+", Some(3), None).unwrap(), [send("#3J+")]);
        assert_eq!(of("J+ #2J-", Some(3), Some(1)).unwrap(), [send("#3J+ #2J-")]);
        assert_eq!(of("#2J-", Some(3), Some(1)).unwrap(), [send("#2J-")]);
        assert_eq!(of("B1R", Some(3), Some(2)).unwrap(), [send("&2B1R")]);
        assert_eq!(of("#1->", Some(3), Some(2)).unwrap(), [send("&2#1->")]);
        assert_eq!(of("%PVF", Some(3), Some(2)).unwrap(), [send("&2#3%PVF")]);
        assert_eq!(of("I122=5 SAVE", Some(3), Some(2)).unwrap(), [send("I122=5 SAVE")]);
        assert_eq!(of("#4 i3=2 J+", None, None).unwrap(), [send("#4"), Piece::Set(3, 2), send("#4J+")]);
        assert_eq!(of("J+", None, None).unwrap(), [send("J+")]);
    }

    #[test]
    fn of_a_reader_the_board_hears_only_the_addresses_that_a_question_needs() {
        let read = |line: &str, motor: Option<u32>| {
            let kept = Kept { version: None, addresses: true };
            pieces(line, &tokens_of(line), Addressed { motor, system: None }, kept).unwrap()
        };
        assert_eq!(read("#2", None), [Piece::Nothing]);
        assert_eq!(read("&2#3", None), [Piece::Nothing, Piece::Nothing]);
        assert_eq!(read("P", Some(2)), [send("#2P")]);
        assert_eq!(read("#2P#3", None), [send("#2P"), Piece::Nothing]);
        assert_eq!(read("#2 P1 #3P", None), [Piece::Nothing, send("P1 #3P")]);
        assert_eq!(read("#2&1?", None), [Piece::Nothing, Piece::Nothing, send("#2?")]);
        assert_eq!(read("&1#1-> &2%", None), [send("&1#1-> &2%")]);
        assert_eq!(read("#1#2->", None), [Piece::Nothing, send("#2->")]);
        assert_eq!(read("#1?#2?", None), [send("#1?#2?")]);
        assert_eq!(read("##", Some(2)), [send("##")]);
        assert_eq!(read("#", Some(2)), [send("#2#")]);
    }

    #[test]
    fn too_long_a_line_goes_in_parts_or_not_at_all() {
        let poll: String = (1..=16).map(|motor| format!("#{motor}?PVF m{motor}90 p{motor}99")).collect();
        let line = format!("i65???&1??%{poll}");
        let told = of(&line, None, None).unwrap();
        assert!(told.len() > 1);
        let mut whole = String::new();
        for piece in &told {
            let Piece::Send(text) = piece else { panic!("{piece:?}") };
            assert!(text.len() <= LINE_MAX && (whole.is_empty() || text.starts_with('#')), "{text}");
            whole += text;
        }
        assert_eq!(whole, line);
        // One command of another kind, anywhere in the line, and nothing of the line is sent.
        for line in ["P1=1 ".repeat(50) + "#1J+", "&1A ".to_owned() + &"P1=1 ".repeat(50)] {
            let Err(Failure::Refused { code, .. }) = of(&line, None, None) else { panic!("{line}") };
            assert_eq!(code, board::NO_ROOM);
        }
        // Questions without an address: the cut may stand between any two.
        let told = of(&"M5000 ".repeat(80), None, None).unwrap();
        let whole: Vec<&Piece> = told.iter().filter(|piece| matches!(piece, Piece::Send(_))).collect();
        assert!(whole.len() == told.len() && told.len() > 1);
        assert_eq!(format!("{told:?}").matches("M5000").count(), 80);
        assert!(of(&format!("SEND\"{}\"", "x".repeat(250)), None, None).is_err());
    }

    #[test]
    fn too_long_assignments_go_in_parts_that_say_whose_they_are() {
        let line: String = (1..=60).map(|number| format!("Q{number}={number} ")).collect();
        let told = of(&line, None, Some(3)).unwrap();
        assert!(told.len() > 1);
        let texts = told.iter().map(|piece| match piece {
            Piece::Send(text) => text.strip_prefix("&3").unwrap_or_else(|| panic!("{text}")),
            other => panic!("{other:?}"),
        });
        assert_eq!(texts.collect::<Vec<_>>().join(" "), line.trim_end());
    }

    #[test]
    fn too_long_a_write_of_memory_goes_in_rows() {
        let values: Vec<String> = (0..17).map(|value| format!("${value:012X}")).collect();
        for (head, second) in [("WL:$C5FC", "WL:$C609"), ("wl$00C5FC", "wl$00C609"), ("WX 50684", "WX50697")]
        {
            let line = format!("P1=1 {head},{} P2=2", values.join(","));
            let short = short_writes(&line, &tokens_of(&line)).unwrap();
            let told = of(&short, None, None).unwrap();
            let texts: Vec<&str> = told
                .iter()
                .map(|piece| match piece {
                    Piece::Send(text) => text.as_str(),
                    other => panic!("{other:?}"),
                })
                .collect();
            assert!(texts.iter().all(|text| text.len() <= LINE_MAX), "{texts:?}");
            let head = head.replace(' ', "");
            let whole = [
                format!("P1=1 {head},{}", values[..13].join(",")),
                format!("{second},{}", values[13..].join(",")) + " P2=2",
            ];
            assert_eq!(texts, whole);
        }
        assert_eq!(short_writes("WX$770,1", &tokens_of("WX$770,1")), None);
    }
}
