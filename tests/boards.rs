//! Every board file that is shipped is one that the program takes.

mod support;

use glasswing::app::board::Board;

#[test]
fn every_shipped_board_file_is_taken() {
    let folder = support::source_dir().join("boards");
    let mut taken = 0;
    for entry in std::fs::read_dir(&folder).expect("the folder of boards") {
        let path = entry.expect("a readable entry").path();
        // Beside them lie the protocol file for FlightGear and a flight profile.
        let is_board = path.extension().is_some_and(|kind| kind == "toml");
        if !is_board || path.ends_with("profile-demo.toml") {
            continue;
        }
        if let Err(faults) = Board::load(&path) {
            let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
            panic!("{}:\n{}", path.display(), lines.join("\n"));
        }
        taken += 1;
    }
    assert!(taken >= 3, "only {taken} board files were found");
}
