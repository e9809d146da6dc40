//! A table of a board file, read key by key: what is taken is checked, what is left over is unknown, and every problem is
//! kept so that the user sees all of them at once.

use crate::app::error::{Failure, Kind};
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;
use std::str::FromStr;
use toml::{Table, Value};

/// One thing that is wrong with a board file.
#[derive(Debug)]
pub(super) struct Problem {
    key: String,
    why: String,
    todo: String,
}

impl Problem {
    pub(super) fn new(key: &str, why: impl Display, todo: impl Display) -> Self {
        Self {
            key: key.to_owned(),
            why: why.to_string(),
            todo: todo.to_string(),
        }
    }

    pub(super) fn into_failure(self, file: &Path) -> Failure {
        let what = if self.key.is_empty() {
            file.display().to_string()
        } else {
            format!("{}: {}", file.display(), self.key)
        };
        Failure::new(Kind::Usage, what, self.why, self.todo)
    }
}

/// A table being read.
#[derive(Debug)]
pub(super) struct Reader {
    path: String,
    table: Table,
    known: Vec<&'static str>,
}

impl Reader {
    pub(super) fn new(path: &str, table: Table) -> Self {
        Self {
            path: path.to_owned(),
            table,
            known: Vec::new(),
        }
    }

    /// The full path of a key of this table.
    pub(super) fn path(&self, key: &str) -> String {
        match (self.path.as_str(), key) {
            ("", key) => key.to_owned(),
            (path, "") => path.to_owned(),
            (path, key) => format!("{path}.{key}"),
        }
    }

    /// Whether the key is given and not taken yet.
    pub(super) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    pub(super) fn take(&mut self, key: &'static str) -> Option<Value> {
        self.known.push(key);
        self.table.remove(key)
    }

    fn missing(&self, key: &str, problems: &mut Vec<Problem>) {
        let todo = "give it, or write inherit = \"base\" at the top of the file";
        problems.push(Problem::new(&self.path(key), "is missing", todo));
    }

    pub(super) fn table(&mut self, key: &'static str, problems: &mut Vec<Problem>) -> Self {
        let path = self.path(key);
        match self.take(key) {
            Some(Value::Table(t)) => Self::new(&path, t),
            Some(other) => {
                let why = format!("is {}", a(&other));
                problems.push(Problem::new(
                    &path,
                    why,
                    format!("write [{path}] above its keys"),
                ));
                Self::new(&path, Table::new())
            }
            None => Self::new(&path, Table::new()),
        }
    }

    pub(super) fn tables(&mut self, key: &'static str, problems: &mut Vec<Problem>) -> Vec<Self> {
        let path = self.path(key);
        let list = match self.take(key) {
            Some(Value::Array(list)) => list,
            None => Vec::new(),
            Some(other) => vec![other],
        };
        let mut readers = Vec::new();
        for (i, value) in list.into_iter().enumerate() {
            let path = format!("{path}[{i}]");
            match value {
                Value::Table(t) => readers.push(Self::new(&path, t)),
                other => {
                    let why = format!("is {}", a(&other));
                    problems.push(Problem::new(&path, why, "write [[source]] above its keys"));
                }
            }
        }
        readers
    }

    pub(super) fn optional_text(
        &mut self,
        key: &'static str,
        problems: &mut Vec<Problem>,
    ) -> Option<String> {
        match self.take(key)? {
            Value::String(s) if !s.is_empty() => Some(s),
            other => {
                let why = format!("is {}, not a text", a(&other));
                problems.push(Problem::new(&self.path(key), why, "write it in quotes"));
                None
            }
        }
    }

    pub(super) fn text(
        &mut self,
        key: &'static str,
        problems: &mut Vec<Problem>,
    ) -> Option<String> {
        if !self.table.contains_key(key) {
            self.missing(key, problems);
        }
        self.optional_text(key, problems)
    }

    pub(super) fn optional_parsed<T: FromStr>(
        &mut self,
        key: &'static str,
        form: &str,
        problems: &mut Vec<Problem>,
    ) -> Option<T> {
        let text = self.optional_text(key, problems)?;
        let parsed = text.parse().ok();
        if parsed.is_none() {
            let why = format!("`{text}` is not understood");
            problems.push(Problem::new(&self.path(key), why, format!("write {form}")));
        }
        parsed
    }

    pub(super) fn parsed<T: FromStr<Err = String>>(
        &mut self,
        key: &'static str,
        problems: &mut Vec<Problem>,
    ) -> Option<T> {
        match self.text(key, problems)?.parse() {
            Ok(value) => Some(value),
            Err(why) => {
                let todo = "correct it; boards/base.toml shows every key";
                problems.push(Problem::new(&self.path(key), why, todo));
                None
            }
        }
    }

    pub(super) fn optional_list<T: FromStr>(
        &mut self,
        key: &'static str,
        form: &str,
        problems: &mut Vec<Problem>,
    ) -> Vec<T> {
        let list = match self.take(key) {
            None => return Vec::new(),
            Some(Value::Array(list)) => list,
            Some(other) => vec![other],
        };
        let mut values = Vec::new();
        for value in list {
            let parsed = value.as_str().and_then(|s| s.parse().ok());
            match parsed {
                Some(value) => values.push(value),
                None => {
                    let why = format!("{} is not {form}", a(&value));
                    let todo = format!("write a list of them, each {form} in quotes");
                    problems.push(Problem::new(&self.path(key), why, todo));
                }
            }
        }
        values
    }

    pub(super) fn choice<T: Copy>(
        &mut self,
        key: &'static str,
        choices: &[(&str, T)],
        problems: &mut Vec<Problem>,
    ) -> Option<T> {
        let text = self.text(key, problems)?;
        let chosen = choices
            .iter()
            .find(|(name, _)| *name == text)
            .map(|(_, value)| *value);
        if chosen.is_none() {
            let names: Vec<_> = choices.iter().map(|(name, _)| *name).collect();
            let todo = format!("choose one of: {}", names.join(", "));
            problems.push(Problem::new(
                &self.path(key),
                format!("`{text}` is unknown"),
                todo,
            ));
        }
        chosen
    }

    pub(super) fn optional_number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f64>,
        problems: &mut Vec<Problem>,
    ) -> Option<f64> {
        let number = match self.take(key)? {
            Value::Float(x) => Ok(x),
            #[expect(
                clippy::cast_precision_loss,
                reason = "compared with a range of small numbers next"
            )]
            Value::Integer(i) => Ok(i as f64),
            other => Err(format!("is {}, not a number", a(&other))),
        };
        let checked = number.and_then(|x| {
            if range.contains(&x) {
                Ok(x)
            } else {
                Err(format!("{x} is out of range"))
            }
        });
        checked
            .map_err(|why| {
                let todo = format!("give a number from {} to {}", range.start(), range.end());
                problems.push(Problem::new(&self.path(key), why, todo));
            })
            .ok()
    }

    pub(super) fn number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f64>,
        problems: &mut Vec<Problem>,
    ) -> Option<f64> {
        if !self.table.contains_key(key) {
            self.missing(key, problems);
        }
        self.optional_number(key, range, problems)
    }

    pub(super) fn optional_whole(
        &mut self,
        key: &'static str,
        range: RangeInclusive<u32>,
        problems: &mut Vec<Problem>,
    ) -> Option<u32> {
        let bounds = f64::from(*range.start())..=f64::from(*range.end());
        let number = self.optional_number(key, bounds, problems)?;
        if number.fract() != 0.0 {
            let why = format!("{number} has a fraction");
            problems.push(Problem::new(&self.path(key), why, "give a whole number"));
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole and within a range of u32"
        )]
        Some(number as u32)
    }

    pub(super) fn whole(
        &mut self,
        key: &'static str,
        range: RangeInclusive<u32>,
        problems: &mut Vec<Problem>,
    ) -> Option<u32> {
        if !self.has(key) {
            self.missing(key, problems);
        }
        self.optional_whole(key, range, problems)
    }

    pub(super) fn choice_of_number(
        &mut self,
        key: &'static str,
        choices: &[u32],
        problems: &mut Vec<Problem>,
    ) -> Option<u32> {
        let number = self.whole(key, 0..=u32::MAX, problems)?;
        if !choices.contains(&number) {
            let todo = format!("choose one of {choices:?}");
            problems.push(Problem::new(
                &self.path(key),
                format!("{number} is not offered"),
                todo,
            ));
            return None;
        }
        Some(number)
    }

    pub(super) fn flag(&mut self, key: &'static str, problems: &mut Vec<Problem>) -> Option<bool> {
        match self.take(key) {
            Some(Value::Boolean(b)) => Some(b),
            Some(other) => {
                let why = format!("is {}", a(&other));
                problems.push(Problem::new(&self.path(key), why, "write true or false"));
                None
            }
            None => {
                self.missing(key, problems);
                None
            }
        }
    }

    /// Whatever was not taken is unknown.
    pub(super) fn finish(self, problems: &mut Vec<Problem>) {
        for key in self.table.keys() {
            let stem = |k: &str| k.split('_').next().map(str::to_owned);
            // The same quantity in another unit is the commonest slip: say which unit is meant.
            let near = self.known.iter().find(|known| stem(known) == stem(key));
            let todo = match near {
                Some(near) => format!("did you mean `{near}`? Its unit is part of its name"),
                None if self.known.is_empty() => "remove it".to_owned(),
                None => format!("known here: {}", self.known.join(", ")),
            };
            problems.push(Problem::new(&self.path(key), "is an unknown key", todo));
        }
    }
}

/// What kind of value it is, in words.
pub(super) fn a(value: &Value) -> &'static str {
    match value {
        Value::String(_) => "a text",
        Value::Integer(_) => "a whole number",
        Value::Float(_) => "a number",
        Value::Boolean(_) => "true or false",
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list",
        Value::Table(_) => "a table",
    }
}
