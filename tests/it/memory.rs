//! `pmacctl doctor --memory`: who uses which stretch of the DPRAM.

use serde_json::Value;

use crate::support::VirtualSite;

/// The text of the check of the region `name`, and its level.
fn stretch(site: &VirtualSite, name: &str) -> (String, String) {
    let (_, text, error) = site.hurried(|| site.pmacctl(&["doctor", "--memory", "--json"]));
    let checks: Value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{text}{error}"));
    let checks = checks.as_array().unwrap().iter();
    let own = checks.filter(|check| check["text"].as_str().unwrap().starts_with(name));
    let [check] = own.collect::<Vec<_>>()[..] else { panic!("{text}") };
    (check["level"].as_str().unwrap().to_owned(), check["text"].as_str().unwrap().to_owned())
}

#[test]
fn doctor_memory_prints_who_uses_which_stretch() {
    for (family, definitions, servo, all) in [
        (
            "turbo2",
            ["M211->DP:$60080", "M8191->X:$060019,0,16", "M500->F:$060900"],
            "servo from 0x0068, 1548 bytes",
            [211, 8191, 500],
        ),
        (
            "pmac",
            ["M211->DP:$D012", "M1023->Y:$D005,0,16", "M500->F:$D900"],
            "servo from 0x0024, 516 bytes",
            [211, 1023, 500],
        ),
    ] {
        let site = VirtualSite::configured(
            &["--family", family],
            &format!("family = \"{family}\"\nfunctions = [\"ascii\", \"servo\"]\n"),
        );
        let (level, text) = stretch(&site, "servo ");
        assert_eq!((level.as_str(), text.starts_with(servo)), ("ok", true), "{text}");
        assert!(text.contains("pmacd uses servo; the board's programs: no M-variable"), "{text}");
        for definition in definitions {
            let (code, _, error) = site.hurried(|| site.pmacctl(&["send", definition]));
            assert_eq!(code, 0, "{definition}: {error}");
        }
        let (level, text) = stretch(&site, "servo ");
        assert!(level == "warn" && text.contains(&format!("M{}->DP:$", all[0])), "{level} {text}");
        assert!(text.contains("leave the function out of `functions`"), "{text}");
        // The panel is not used, and the user area is for both.
        for (name, number) in [("panel ", all[1]), ("user ", all[2])] {
            let (level, text) = stretch(&site, name);
            assert!(level == "ok" && text.contains(&format!("M{number}->")), "{level} {text}");
        }
        let (level, text) = stretch(&site, "background ");
        assert!(
            level == "ok" && text.contains("pmacd uses nothing; the board's programs: no M-variable"),
            "{text}"
        );
        site.assert_no_violations();
    }
}

#[test]
fn doctor_memory_asks_nothing_while_a_program_buffer_is_open() {
    let site = VirtualSite::running(&[], &[]);
    for line in ["OPEN PROG 7 CLEAR", "X1"] {
        let (code, _, error) = site.hurried(|| site.pmacctl(&["send", line]));
        assert_eq!(code, 0, "{line}: {error}");
    }
    let (code, text, error) = site.hurried(|| site.pmacctl(&["doctor", "--memory"]));
    assert!(code != 0 && error.contains("PROG 7"), "{code} {text} {error}");
    for line in ["CLOSE", "LIST PROG 7"] {
        let (code, text, error) = site.hurried(|| site.pmacctl(&["send", line]));
        assert!(code == 0 && !text.contains("M0"), "{line}: {text} {error}");
    }
}
