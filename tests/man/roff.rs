//! A manual page as text for `man`.

/// A page that is being written.
pub struct Page(String);

impl Page {
    /// A page of this name and section.
    pub fn new(name: &str, section: &str, manual: &str) -> Self {
        let version = env!("CARGO_PKG_VERSION");
        let name = quoted(&name.to_uppercase());
        Self(format!(".TH {name} {section} \"\" \"pmac\\-dpram {version}\" {}\n", quoted(manual)))
    }

    /// A page whose first sections are there already.
    pub fn from(text: &str) -> Self {
        Self(text.to_owned())
    }

    /// Begins a section.
    pub fn section(&mut self, title: &str) {
        self.0 += &format!(".SH {}\n", quoted(title));
    }

    /// Begins a part of a section.
    pub fn part(&mut self, title: &str) {
        self.0 += &format!(".SS {}\n", quoted(title));
    }

    /// Words in roman, which a new line does not end.
    pub fn text(&mut self, text: &str) {
        self.markup(&escaped(text));
    }

    /// The same of words that are marked up already.
    pub fn markup(&mut self, text: &str) {
        if text.starts_with(['.', '\'']) {
            self.0 += "\\&";
        }
        self.0 += text;
        self.0.push('\n');
    }

    /// Begins a paragraph.
    pub fn paragraph(&mut self) {
        self.0 += ".PP\n";
    }

    /// Begins a line.
    pub fn line_break(&mut self) {
        self.0 += ".br\n";
    }

    /// An entry of a list: what it is called, marked up, and what it is.
    pub fn entry(&mut self, markup: &str, text: &str) {
        self.0 += ".TP\n";
        self.markup(markup);
        self.text(text);
    }

    /// Lines as they are typed.
    pub fn typed(&mut self, lines: &[&str]) {
        self.0 += ".PP\n.RS 4\n.nf\n";
        for line in lines {
            self.markup(&bold(line));
        }
        self.0 += ".fi\n.RE\n";
    }

    /// The page.
    pub fn finish(self) -> String {
        self.0
    }
}

/// Words in bold.
pub fn bold(text: &str) -> String {
    format!("\\fB{}\\fR", escaped(text))
}

/// Words in italics.
pub fn italic(text: &str) -> String {
    format!("\\fI{}\\fR", escaped(text))
}

/// Words as they stand, none of them a request to `man`.
pub fn escaped(text: &str) -> String {
    text.replace('\\', "\\e")
        .replace('-', "\\-")
        .replace('^', "\\(ha")
        .replace('\'', "\\(aq")
        .replace('`', "\\(ga")
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", escaped(text).replace('"', "\\(dq"))
}
