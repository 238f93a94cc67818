//! The motor and the coordinate system that a client's lines mean where the lines name none.

use pmac_dpram::language::lexer::{Kind, Needs, Token};

/// The motor and the coordinate system that a client addresses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Addressed {
    pub(crate) motor: Option<u32>,
    pub(crate) system: Option<u32>,
}

/// What a line must name itself, unless the client has named it since.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Doubt {
    pub(crate) motor: bool,
    pub(crate) system: bool,
}

impl Doubt {
    /// The gateway knows nothing of the client.
    pub(crate) const ALL: Self = Self { motor: true, system: true };
}

impl Addressed {
    /// A board addresses these after it has come up.
    const AT_POWER_UP: Self = Self { motor: Some(1), system: Some(1) };

    /// The motor and the system that both agree on.
    pub(crate) fn common(self, other: Self) -> Self {
        let same = |one: Option<u32>, other| one.filter(|_| one == other);
        Self { motor: same(self.motor, other.motor), system: same(self.system, other.system) }
    }

    /// Follows the addresses of a whole line.
    pub(crate) fn follow_all(&mut self, tokens: &[Token]) {
        tokens.iter().for_each(|token| self.follow(token));
        if tokens.iter().any(|token| token.kind == Kind::Resets) {
            *self = Self::AT_POWER_UP;
        }
    }

    pub(crate) fn follow(&mut self, token: &Token) {
        match token.kind {
            Kind::Motor(number) | Kind::AxisOf(number) | Kind::DefinesAxis(number) => {
                self.motor = Some(number)
            }
            Kind::System(number) => self.system = Some(number),
            _ => {}
        }
    }

    /// The address to send before `tokens`, so that they mean the addressed motor and coordinate system.
    pub(crate) fn prefix(self, tokens: &[Token]) -> String {
        let is_needed = |needs| uses_of(tokens, needs).next().is_some();
        let system = self.system.filter(|_| is_needed(Needs::System));
        let motor = self.motor.filter(|_| is_needed(Needs::Motor));
        let system = system.map(|number| format!("&{number}")).unwrap_or_default();
        motor.map_or(system.clone(), |number| format!("{system}#{number}"))
    }

    /// Whether the gateway knows the motor and the system that `tokens` need, where these are in `doubt`. Commands
    /// whose need is unknown do not count.
    pub(crate) fn suffices(self, tokens: &[Token], doubt: Doubt) -> bool {
        let is_needed = |needs| uses_of(tokens, needs).any(|token| token.kind.needs() == needs);
        let is_open =
            |in_doubt: bool, known: Option<u32>, needs| in_doubt && known.is_none() && is_needed(needs);
        !is_open(doubt.motor, self.motor, Needs::Motor) && !is_open(doubt.system, self.system, Needs::System)
    }
}

/// The commands that mean the motor, or the coordinate system, that was addressed before `tokens`.
pub(crate) fn uses_of(tokens: &[Token], needs: Needs) -> impl Iterator<Item = &Token> {
    let is_other = move |token: &&Token| match token.kind {
        Kind::Motor(_) | Kind::AxisOf(_) | Kind::DefinesAxis(_) => needs != Needs::Motor,
        Kind::System(_) => needs != Needs::System,
        _ => true,
    };
    tokens.iter().take_while(is_other).filter(move |token| match token.kind {
        // Unknown whether these need a motor or a coordinate system.
        Kind::Statement(_) | Kind::Quoted | Kind::Unknown => true,
        kind => kind.needs() == needs,
    })
}
