//! Which board: the `--board` specification, parsed.

use std::path::PathBuf;
use std::str::FromStr;

use super::InterruptSource;

/// What the user wrote after `--board`.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum BoardSpec {
    /// `sim`: start a simulator and use its memory.
    Simulator,
    /// `file:PATH[,irq=unix:PATH]`: a file some other process treats as its DPRAM.
    File {
        /// The memory file.
        path: PathBuf,
        /// Where its interrupt is announced, if anywhere.
        interrupt: Option<InterruptSource>,
    },
}

/// Why a board specification was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("board `{spec}`: {reason}; write sim or file:PATH[,irq=unix:PATH]")]
pub struct SpecError {
    spec: String,
    reason: String,
}

impl FromStr for BoardSpec {
    type Err = SpecError;

    fn from_str(spec: &str) -> Result<Self, SpecError> {
        let refuse = |reason: String| SpecError { spec: spec.to_owned(), reason };
        let (kind, rest) = spec.split_once(':').unwrap_or((spec, ""));
        match kind {
            "sim" if rest.is_empty() => Ok(Self::Simulator),
            "sim" => Err(refuse("sim takes nothing after it".to_owned())),
            "file" => {
                let mut parts = rest.split(',');
                let path = parts.next().filter(|path| !path.is_empty());
                let path = path.ok_or_else(|| refuse("the path after file: is missing".to_owned()))?;
                let mut interrupt = None;
                for option in parts {
                    match option.split_once('=') {
                        Some(("irq", source)) if interrupt.is_none() => {
                            interrupt = Some(source.parse().map_err(refuse)?);
                        }
                        Some(("irq", _)) => return Err(refuse("irq= is given twice".to_owned())),
                        _ => return Err(refuse(format!("unknown option `{option}`"))),
                    }
                }
                Ok(Self::File { path: path.into(), interrupt })
            }
            "mem" | "uio" | "pci" => {
                Err(refuse(format!("{kind}: boards are not in this version, only simulated ones")))
            }
            _ => Err(refuse(format!("there is no board kind `{kind}`"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_what_is_meant() {
        assert_eq!("sim".parse(), Ok(BoardSpec::Simulator));
        assert_eq!(
            "file:/dev/shm/dpram".parse(),
            Ok(BoardSpec::File { path: "/dev/shm/dpram".into(), interrupt: None })
        );
        assert_eq!(
            "file:m,irq=unix:/run/irq".parse(),
            Ok(BoardSpec::File {
                path: "m".into(),
                interrupt: Some(InterruptSource::Unix("/run/irq".into()))
            })
        );
    }

    #[test]
    fn anything_else_is_refused_with_its_reason() {
        for (spec, reason) in [
            ("", "no board kind ``"),
            ("sim:x", "nothing after it"),
            ("file:", "path after file: is missing"),
            ("file:a,irq=b", "irq=b"),
            ("file:a,irq=unix:", "irq=unix:"),
            ("file:a,irq=unix:b,irq=unix:c", "given twice"),
            ("file:a,speed=9", "unknown option `speed=9`"),
            ("mem:0xD4000", "not in this version"),
            ("isa:0x210", "no board kind `isa`"),
        ] {
            let error = spec.parse::<BoardSpec>().unwrap_err().to_string();
            assert!(error.contains(reason), "{spec}: {error}");
        }
    }
}
