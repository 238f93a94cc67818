//! The looks of text: never by colour alone, and without colours if `NO_COLOR` is set (no-color.org).

use ratatui::style::{Color, Modifier, Style};

#[derive(Debug, Clone, Copy)]
pub struct Look {
    colours: bool,
}

impl Look {
    pub const fn new(colours: bool) -> Self {
        Self { colours }
    }

    /// The look that the environment requests.
    pub fn of_environment() -> Self {
        Self::new(std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()))
    }

    const fn coloured(self, style: Style, colour: Color) -> Style {
        if self.colours { style.fg(colour) } else { style }
    }

    pub const fn title(self) -> Style {
        Style::new().add_modifier(Modifier::REVERSED)
    }

    pub const fn heading(self) -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }

    pub const fn selected(self) -> Style {
        Style::new().add_modifier(Modifier::REVERSED)
    }

    /// The style of old data.
    pub const fn old(self) -> Style {
        Style::new().add_modifier(Modifier::DIM)
    }

    /// The style of text that needs the user's attention.
    pub const fn alarm(self) -> Style {
        self.coloured(Style::new().add_modifier(Modifier::BOLD), Color::Red)
    }

    /// The style of armed keys and of a replay.
    pub const fn warning(self) -> Style {
        self.coloured(
            Style::new().add_modifier(Modifier::BOLD).add_modifier(Modifier::REVERSED),
            Color::Yellow,
        )
    }

    pub const fn trace(self) -> Style {
        self.coloured(Style::new(), Color::Cyan)
    }
}
