//! The page of what driver and simulator do where the manuals leave it open.

/// A page of the documentation.
fn page(name: &str) -> String {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name);
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn the_rows_of_the_evidence_are_whole() {
    let evidence = page("evidence.md");
    let rows = evidence.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| sentence"));
    let rows: Vec<Vec<&str>> = rows.map(|row| row.trim_matches('|').split(" | ").collect()).collect();
    assert!(rows.len() > 50, "{} rows", rows.len());
    for row in rows {
        // Of a misprint: what is wrong, what is printed, what holds.
        assert!(row.len() == 5 || row.len() == 3, "{row:?}");
        assert!(row.iter().all(|cell| !cell.trim().is_empty()), "{row:?}");
    }
}

#[test]
fn what_a_step_decides_stands_in_that_step() {
    let (evidence, first) = (page("evidence.md"), page("first-board.md"));
    for named in evidence.split("step ").skip(1) {
        let number: String = named.chars().take_while(char::is_ascii_digit).collect();
        if number.is_empty() {
            continue;
        }
        let step = first.split("\n## ").find(|step| step.starts_with(&format!("{number}. ")));
        let step = step.unwrap_or_else(|| panic!("there is no step {number}"));
        assert!(step.contains("t decides "), "step {number} decides nothing");
    }
}
