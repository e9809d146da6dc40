//! The table: parameter, fault, protocol, and what the state said, after how long; as CSV and to read.

use super::{Cell, SHOWN, TROUBLES};
use glasswing::proto::Protocol;
use std::fmt::Write;

fn seconds(d: Option<std::time::Duration>) -> String {
    d.map_or_else(String::new, |d| format!("{:.2}", d.as_secs_f64()))
}

impl Cell {
    /// What the state said, in a word.
    pub(crate) fn verdict(&self) -> &'static str {
        match (self.wrong, self.after, self.said) {
            (1.., ..) if self.limit.is_some() => "IMPOSSIBLE",
            (1.., ..) => "SHOWN AS GOOD",
            (0, Some(_), Some(reason)) => reason.name(),
            (0, Some(_), None) => "derived",
            (0, None, _) => "true values only",
        }
    }
}

/// One line for each cell.
pub(crate) fn csv(cells: &[Cell]) -> String {
    let mut text = String::from(
        "parameter,fault,protocol,said,after_s,good_again_after_s,wrong_pictures,true_pictures,limit\n",
    );
    for cell in cells {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{}",
            cell.parameter.spec().name,
            cell.trouble.name,
            cell.protocol.name(),
            cell.verdict(),
            seconds(cell.after),
            seconds(cell.back_after),
            cell.wrong,
            cell.true_shown,
            cell.limit.filter(|_| cell.wrong > 0).unwrap_or_default(),
        );
    }
    text
}

/// One table for each fault: rows are parameters, columns protocols.
pub(crate) fn markdown(cells: &[Cell]) -> String {
    let mut text = String::from(
        "# Fault matrix\n\nWhat the state said of each parameter, and after how many seconds. \"derived\": the value is worked \
         out from others that are good. \"true values only\": what was shown was true within its greatest age. \"IMPOSSIBLE\": one source cannot tell, for the reason in the CSV.\n",
    );
    let names = TROUBLES.iter().map(|t| t.name).chain(["reordering"]);
    for fault in names {
        let _ = write!(text, "\n## {fault}\n\n| parameter |");
        for protocol in Protocol::ALL {
            let _ = write!(text, " {} |", protocol.name());
        }
        let _ = writeln!(text, "\n|---|{}", "---|".repeat(Protocol::ALL.len()));
        for parameter in SHOWN {
            let row = |protocol| {
                cells.iter().find(|c| {
                    (c.trouble.name, c.parameter, c.protocol) == (fault, parameter, protocol)
                })
            };
            if Protocol::ALL.into_iter().all(|p| row(p).is_none()) {
                continue;
            }
            let _ = write!(text, "| {} |", parameter.spec().name);
            for protocol in Protocol::ALL {
                match row(protocol) {
                    None => text.push_str(" |"),
                    Some(cell) => {
                        let _ = write!(text, " {} {} |", cell.verdict(), seconds(cell.after));
                    }
                }
            }
            text.push('\n');
        }
    }
    text
}
