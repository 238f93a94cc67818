//! `pmacctl plot`, and the pictures that `gather` and `log` draw of what they wrote.

use std::fs;
use std::path::Path;

use crate::support::VirtualSite;

/// The points of each trace in an SVG file.
fn traces(path: &Path) -> Vec<Vec<[f64; 2]>> {
    let svg = fs::read_to_string(path).unwrap();
    let lines = svg.lines().filter(|line| line.contains("stroke-width=\"1.5\""));
    let points = |line: &str| -> Vec<[f64; 2]> {
        let (_, points) = line.split_once("points=\"").unwrap();
        let numbers = |point: &str| {
            let (x, y) = point.split_once(',').unwrap();
            [x.parse().unwrap(), y.parse().unwrap()]
        };
        points.trim_end_matches("\"/>").split(' ').map(numbers).collect()
    };
    lines.map(points).collect()
}

#[test]
fn gather_and_log_draw_what_they_wrote() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.wait_until("the board's scales", || site.has_scales());
    let [csv, npy, svg, log_svg] = ["g.csv", "l.npy", "g.svg", "l.svg"].map(|name| site.path(name));
    let [csv_name, npy_name, svg_name, log_svg_name] =
        [&csv, &npy, &svg, &log_svg].map(|path| path.to_str().unwrap());
    let sources = ["-s", "1.commanded_position", "-s", "1.actual_position"];
    let gather = [&["gather", "--seconds", "0.5", "-o", csv_name, "--plot", svg_name], &sources[..]].concat();
    let ran = site.hurried(|| site.run(&[&gather[..], &["--then", "#1J:1000"]].concat()));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let picture = fs::read_to_string(&svg).unwrap();
    for text in ["g.csv", "time (s)", "position (count)", "1.commanded_position", "1.actual_position"] {
        assert!(picture.contains(&format!(">{text}</text>")), "{text}");
    }
    // The motor jogs while the board gathers: the traces rise, which is up the page.
    let drawn = traces(&svg);
    assert_eq!(drawn.len(), 2);
    for trace in drawn {
        assert!(trace[0][1] - trace[trace.len() - 1][1] > 200.0, "{trace:?}");
    }

    let log = ["log", "-o", npy_name, "--motors", "1", "--seconds", "0.2", "--plot", log_svg_name];
    let ran = site.run_slowly(&log);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(fs::read(&log_svg).unwrap().starts_with(b"<svg "));
    let ran = site.run(&["plot", npy_name, "-o", "-", "--columns", "1.velocity"]);
    assert!(ran.code == Some(0) && ran.stdout.contains(">1.velocity</text>"), "{ran:?}");
    assert!(!ran.stdout.contains("following_error"));

    for (arguments, said) in [
        (&["plot", csv_name, "-o", "x.png"][..], "the name must end in .svg"),
        (&["plot", "no.csv", "-o", svg_name], "no.csv: No such file"),
        (&["plot", svg_name, "-o", log_svg_name], "g.svg: "),
        (&["plot", "/dev/null", "-o", svg_name], "/dev/null: only a file can be drawn"),
        (&["gather", "-s", "servo_timer", "-o", "-", "--plot", svg_name], "-: only a file can be drawn"),
    ] {
        let ran = site.run(arguments);
        assert!(ran.code == Some(2) && ran.stderr.contains(said), "{arguments:?}: {ran:?}");
    }
}

#[test]
fn a_line_that_the_board_refuses_ends_the_gather() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    let csv = site.path("g.csv");
    let gather = ["gather", "-s", "servo_timer", "-o", csv.to_str().unwrap(), "--then", "XYZZY"];
    let ran = site.hurried(|| site.run(&gather));
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(
        ran.stderr
            .contains("the line of --then, \"XYZZY\", failed, and the gather was ended for that: ERR003"),
        "{ran:?}"
    );
    assert!(!csv.exists());
    site.wait_until("the end of the gather", || site.ask("I19") == ["1"]);
    assert!(!site.log().contains("[ERROR]"), "{}", site.log());
}

#[test]
fn a_gather_opens_no_program_buffer_that_would_keep_its_own_end_back() {
    let site = VirtualSite::running(&[], &[]);
    let csv = site.path("g.csv");
    let ran = site.run(&[
        "gather",
        "-s",
        "servo_timer",
        "-o",
        csv.to_str().unwrap(),
        "--then",
        "OPEN PROG 3 CLEAR",
    ]);
    assert!(
        ran.code == Some(2) && ran.stderr.contains("--then: \"OPEN PROG 3 CLEAR\" opens a program buffer"),
        "{ran:?}"
    );
    assert!(!csv.exists());
}
