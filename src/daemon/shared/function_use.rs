//! The functions that the daemon uses: those of the configuration, as far as the board's own programs leave them free.

use crate::map::{Family, Function, HostOffset};
use crate::protocol::{BoardSettings, ProgramWords};

const COUNT: usize = Function::ALL.len();

/// The use of a function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FunctionState {
    /// The configuration leaves it out.
    Off,
    /// The daemon does not use the function yet: it first asks the board where its M-variables point.
    Waits,
    /// The daemon uses the function.
    #[default]
    On,
    /// The daemon does not use the function: M-variables point into its words.
    Held,
}

/// M-variables that point into a function's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pointers {
    /// The first of these M-variables.
    pub variable: u16,
    /// The word that it points to.
    pub word: HostOffset,
    /// How many more M-variables point there.
    pub others: u16,
}

/// The use of every function. Before the bus thread has reported, the daemon uses the functions of the configuration.
/// Held in place: passing it on allocates nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FunctionUse {
    uses: [FunctionState; COUNT],
    pointers: [Option<Pointers>; COUNT],
}

impl FunctionUse {
    /// The functions of `settings`. If the daemon first asks the board where its M-variables point (`is_asked`), all
    /// functions wait for the answer, except command lines and the functions that the daemon uses wherever M-variables
    /// point.
    #[must_use]
    pub fn new(settings: &BoardSettings, is_asked: bool) -> Self {
        let uses = Function::ALL.map(|function| match settings.functions.has(function) {
            false => FunctionState::Off,
            true if is_asked && function != Function::Ascii && !settings.shared_functions.has(function) => {
                FunctionState::Waits
            }
            true => FunctionState::On,
        });
        Self { uses, ..Self::default() }
    }

    /// The use of `function`.
    #[must_use]
    pub const fn of(&self, function: Function) -> FunctionState {
        self.uses[function as usize]
    }

    /// The M-variables that point into the words of `function`, as far as the daemon knows.
    #[must_use]
    pub const fn pointers(&self, function: Function) -> Option<Pointers> {
        self.pointers[function as usize]
    }

    /// Begins to use `function` if it waits.
    pub fn begin(&mut self, function: Function) {
        let own = &mut self.uses[function as usize];
        if *own == FunctionState::Waits {
            *own = FunctionState::On;
        }
    }

    /// Takes the board's answers about its M-variables. The daemon does not use a function if an M-variable points into
    /// its words, unless the function `stays`. If not `is_all`, the answers decide nothing on functions without such an
    /// M-variable.
    pub fn decide(
        &mut self,
        pointers: [Option<Pointers>; COUNT],
        is_all: bool,
        stays: impl Fn(Function) -> bool,
    ) {
        for function in Function::ALL {
            let found = pointers[function as usize];
            if found.is_none() && !is_all {
                continue;
            }
            self.pointers[function as usize] = found;
            let own = &mut self.uses[function as usize];
            if *own != FunctionState::Off {
                *own =
                    if found.is_some() && !stays(function) { FunctionState::Held } else { FunctionState::On };
            }
        }
    }

    /// The functions that wait.
    pub fn waiting(&self) -> impl Iterator<Item = Function> {
        Function::ALL.into_iter().filter(|function| self.of(*function) == FunctionState::Waits)
    }

    /// The text for clients about functions into whose words M-variables point.
    pub fn program_words(&self, family: &'static Family) -> impl Iterator<Item = ProgramWords> {
        let pointers = Function::ALL.into_iter().zip(self.pointers).zip(self.uses);
        pointers.filter(|(_, own)| *own != FunctionState::Off).filter_map(
            move |((function, pointers), own)| {
                let Pointers { variable, word, others } = pointers?;
                let (place, used) = (family.print_half(word), own == FunctionState::On);
                Some(ProgramWords { function, variable: variable.into(), place, others: others.into(), used })
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;
    use crate::protocol::Functions;

    #[test]
    fn a_function_is_used_when_no_m_variable_points_into_its_words() {
        let functions = Functions::all(&PMAC).without(Function::Gather);
        let settings = BoardSettings { functions, ..BoardSettings::default() };
        let mut uses = FunctionUse::new(&settings, true);
        assert_eq!(
            (uses.of(Function::Ascii), uses.of(Function::Gather)),
            (FunctionState::On, FunctionState::Off)
        );
        assert_eq!(uses.waiting().count(), 5);
        uses.begin(Function::Servo);
        assert_eq!(
            (uses.of(Function::Servo), uses.of(Function::Panel)),
            (FunctionState::On, FunctionState::Waits)
        );
        let mut found = [None; COUNT];
        let pointers = Pointers { variable: 211, word: HostOffset::new(0x48), others: 3 };
        for function in [Function::Servo, Function::Panel, Function::Gather] {
            found[function as usize] = Some(pointers);
        }
        uses.decide(found, true, |function| function == Function::Panel);
        let own = [Function::Servo, Function::Panel, Function::Gather, Function::Rotary];
        assert_eq!(
            own.map(|function| uses.of(function)),
            [FunctionState::Held, FunctionState::On, FunctionState::Off, FunctionState::On]
        );
        let told: Vec<_> =
            uses.program_words(&PMAC).map(|words| (words.function, words.place, words.used)).collect();
        assert_eq!(
            told,
            [(Function::Panel, "Y:$D012".to_owned(), true), (Function::Servo, "Y:$D012".to_owned(), false)]
        );
        uses.decide([None; COUNT], false, |_| false);
        assert_eq!(uses.of(Function::Servo), FunctionState::Held, "that is not all");
        uses.decide([None; COUNT], true, |_| false);
        assert_eq!(uses.of(Function::Servo), FunctionState::On);
        let mut uses = FunctionUse::new(&settings, true);
        uses.decide(found, false, |_| false);
        let own = [Function::Servo, Function::Panel, Function::Gather, Function::Rotary];
        assert_eq!(
            own.map(|function| uses.of(function)),
            [FunctionState::Held, FunctionState::Held, FunctionState::Off, FunctionState::Waits]
        );
        uses.begin(Function::Servo);
        assert_eq!(uses.of(Function::Servo), FunctionState::Held, "whatever else begins");
        assert_eq!(FunctionUse::new(&settings, false).of(Function::Servo), FunctionState::On);
        let others = Function::ALL.into_iter().filter(|function| *function != Function::Rotary);
        let shared_functions = others.fold(Functions::all(&PMAC), Functions::without);
        let uses = FunctionUse::new(&BoardSettings { shared_functions, ..settings }, true);
        assert_eq!(
            (uses.of(Function::Rotary), uses.of(Function::Servo)),
            (FunctionState::On, FunctionState::Waits)
        );
    }
}
