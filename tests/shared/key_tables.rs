//! Tables of keys in documents (`| key | value | default | means |`), held against what reads such a file.

/// The header of a table of keys.
const HEADER: &str = "| key | value | default | means |";
/// The default of a key that a file must have.
const NEEDED: &str = "*(needed)*";

/// A table and the heading above it.
pub struct KeyTable {
    pub heading: String,
    pub rows: Vec<KeyRow>,
}

/// One key.
pub struct KeyRow {
    pub key: String,
    pub value: String,
    default: String,
}

impl KeyRow {
    /// A key that stands in no table.
    pub fn of(key: &str) -> KeyRow {
        KeyRow { key: key.to_owned(), value: String::new(), default: String::new() }
    }

    /// The range that its value cell gives, of a number or of each of three.
    fn range(&self) -> Option<(f64, f64)> {
        let is_of_numbers = !self.value.ends_with("points") && !self.value.ends_with("bytes");
        let words: Vec<&str> = self.value.split(' ').map(|word| word.trim_end_matches(['°', ','])).collect();
        let at = words.iter().position(|word| *word == "to").filter(|_| is_of_numbers)?;
        Some((words.get(at.checked_sub(1)?)?.parse().ok()?, words.get(at + 1)?.parse().ok()?))
    }

    /// A number as TOML writes this key's value.
    fn written(&self, number: f64) -> String {
        if self.value.starts_with("three numbers") {
            format!("[{number}, {number}, {number}]")
        } else {
            number.to_string()
        }
    }

    fn is_needed(&self) -> bool {
        self.default == NEEDED
    }
}

/// The tables of a document, in its order.
pub fn tables(text: &str) -> Vec<KeyTable> {
    let mut tables: Vec<KeyTable> = Vec::new();
    let (mut heading, mut is_within) = ("", false);
    for line in text.lines() {
        if line.starts_with('#') {
            heading = line.trim_start_matches('#').trim();
        }
        if line == HEADER {
            tables.push(KeyTable { heading: heading.to_owned(), rows: Vec::new() });
        }
        is_within = line == HEADER || (is_within && line.starts_with('|'));
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if let (true, [_, key, value, default, ..]) = (is_within, &cells[..])
            && let (Some(key), Some(table)) = (code(key), tables.last_mut())
        {
            let default = code(default).unwrap_or(default).to_owned();
            table.rows.push(KeyRow { key: key.to_owned(), value: (*value).to_owned(), default });
        }
    }
    tables
}

/// What stands in code style, if the whole cell does.
fn code(cell: &str) -> Option<&str> {
    cell.strip_prefix('`')?.strip_suffix('`').filter(|code| !code.contains('`'))
}

/// The line that refuses a file.
#[derive(Debug, PartialEq)]
pub struct Refusal(pub String);

impl Refusal {
    pub fn of(error: impl std::error::Error) -> Refusal {
        Refusal(error.to_string())
    }
}

/// What is read of a file with these keys and values in the table of a heading: all that it means, or why it is refused.
pub type Read<'a> = dyn Fn(&str, &[(String, String)]) -> Result<String, Refusal> + 'a;

/// Fails unless each row of a table says what the reader does: needed keys are needed, values at the ends of a range are
/// taken and those beyond refused with that range, and a default changes nothing. `base` is the least that must stand in
/// the table beside that key.
#[track_caller]
pub fn hold(table: &KeyTable, base: &dyn Fn(&KeyRow) -> Vec<(String, String)>, read: &Read<'_>) {
    for row in &table.rows {
        let place = format!("{}, {}", table.heading, row.key);
        let base: Vec<(String, String)> = base(row);
        let others: Vec<(String, String)> = base.iter().filter(|(key, _)| *key != row.key).cloned().collect();
        let with = |value: &str| {
            let own = (row.key.clone(), value.to_owned());
            read(&table.heading, &others.iter().cloned().chain([own]).collect::<Vec<_>>())
        };
        let without = read(&table.heading, &others);
        assert_eq!(without.is_err(), row.is_needed(), "{place}: needed? {without:?}");
        if let (false, false, Ok(without)) = (row.is_needed(), row.default.is_empty(), &without) {
            assert_eq!(with(&row.default).as_ref(), Ok(without), "{place}: its default");
        }
        if let Some((low, high)) = row.range() {
            for number in [low, high] {
                assert!(
                    with(&row.written(number)).is_ok(),
                    "{place}: {number}: {:?}",
                    with(&row.written(number))
                );
            }
            let below = if low.fract() == 0.0 { low - 1.0 } else { low / 2.0 };
            for number in [below, high + 1.0] {
                let Refusal(refusal) = with(&row.written(number)).expect_err(&place);
                assert!(refusal.contains(&format!("{low} to {high}")), "{place}: {number}: {refusal}");
            }
        }
    }
}

/// The names that a refusal of an unknown one lists.
pub fn expected_names(refusal: &str) -> Vec<&str> {
    match refusal.split_once("available keys: ") {
        Some((_, names)) => names.split(['`', '\n']).next().unwrap_or_default().split(", ").collect(),
        None => {
            let listed = refusal.split_once("expected").map_or("", |(_, listed)| listed);
            listed.split('`').skip(1).step_by(2).collect()
        }
    }
}
