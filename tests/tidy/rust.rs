//! As much of the Rust language as the house rules need: text without comments and literals, paths, functions.

/// `text` with every comment, string and character blanked out; lines and columns stay where they are.
pub(crate) fn code_only(text: &str) -> String {
    let source: Vec<char> = text.chars().collect();
    let mut code = String::with_capacity(text.len());
    let mut at = 0;
    while at < source.len() {
        let end = literal_or_comment(&source, at);
        if end == at {
            code.push(source[at]);
            at += 1;
        } else {
            code.extend(
                source[at..end]
                    .iter()
                    .map(|&c| if c == '\n' { c } else { ' ' }),
            );
            at = end;
        }
    }
    code
}

/// Where the comment or literal that starts at `at` ends; `at` itself where none does.
fn literal_or_comment(source: &[char], at: usize) -> usize {
    let next = |n: usize| source.get(at + n).copied().unwrap_or('\n');
    let follows_word = at > 0 && is_word(source[at - 1]);
    match source[at] {
        '/' if next(1) == '/' => find(source, at, &['\n']),
        '/' if next(1) == '*' => end_of_block(source, at),
        '"' => end_of_string(source, at + 1),
        'r' if !follows_word || source[at - 1] == 'b' => {
            let hashes = source[at + 1..].iter().take_while(|&&c| c == '#').count();
            if next(1 + hashes) != '"' {
                return at;
            }
            let mut close = vec!['"'];
            close.extend(std::iter::repeat_n('#', hashes));
            find(source, at + hashes + 2, &close) + close.len()
        }
        // A lifetime has no second quote where a character would have one.
        '\'' if next(1) == '\\' => find(source, at + 3, &['\'']) + 1,
        '\'' if next(2) == '\'' => at + 3,
        _ => at,
    }
    .min(source.len())
}

fn find(source: &[char], from: usize, what: &[char]) -> usize {
    let from = from.min(source.len());
    source[from..]
        .windows(what.len())
        .position(|w| w == what)
        .map_or(source.len(), |n| from + n)
}

fn end_of_string(source: &[char], mut at: usize) -> usize {
    while at < source.len() && source[at] != '"' {
        at += if source[at] == '\\' { 2 } else { 1 };
    }
    at + 1
}

fn end_of_block(source: &[char], at: usize) -> usize {
    let (mut depth, mut at) = (1, at + 2);
    while depth > 0 && at < source.len() {
        match (source[at], source.get(at + 1)) {
            ('/', Some('*')) => (depth, at) = (depth + 1, at + 2),
            ('*', Some('/')) => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
    }
    at
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Where `word` stands in `code` as a whole word.
pub(crate) fn words(code: &str, word: &str) -> Vec<usize> {
    code.match_indices(word)
        .map(|(at, _)| at)
        .filter(|&at| {
            !code[..at].ends_with(is_word) && !code[at + word.len()..].starts_with(is_word)
        })
        .collect()
}

/// The line, counted from 1, of the byte `at`.
pub(crate) fn line_of(code: &str, at: usize) -> usize {
    code[..at].matches('\n').count() + 1
}

/// Every path after `root::` (`crate` in the library, `glasswing` outside), braces unfolded, with the line it begins on.
/// Only the first two names of each are kept: no rule looks deeper.
pub(crate) fn paths(code: &str, root: &str) -> Vec<(usize, Vec<String>)> {
    let mut found = Vec::new();
    for at in words(code, root) {
        if let Some(rest) = code[at + root.len()..].strip_prefix("::") {
            let mut names = Vec::new();
            unfold(rest, &mut Vec::new(), &mut names);
            let line = line_of(code, at);
            found.extend(names.into_iter().map(|path| (line, path)));
        }
    }
    found
}

/// Adds the paths of one use tree; gives what follows it.
fn unfold<'a>(tree: &'a str, before: &mut Vec<String>, found: &mut Vec<Vec<String>>) -> &'a str {
    let tree = tree.trim_start();
    if let Some(mut rest) = tree.strip_prefix('{') {
        loop {
            rest = rest.trim_start();
            if let Some(after) = rest.strip_prefix('}') {
                return after;
            }
            let left = unfold(rest, before, found);
            // Also past `as name` and whatever else a tree may hold.
            match left.find([',', '}']) {
                Some(n) => rest = left[n..].trim_start_matches(','),
                None => return left,
            }
        }
    }
    let end = tree.find(|c| !is_word(c)).unwrap_or(tree.len());
    let rest = &tree[end..];
    before.push(tree[..end].to_owned());
    let rest = match rest.strip_prefix("::") {
        Some(deeper) if before.len() < 2 && deeper.trim_start().starts_with(['{', '_']) => {
            unfold(deeper, before, found)
        }
        Some(deeper) if before.len() < 2 && deeper.starts_with(is_word) => {
            unfold(deeper, before, found)
        }
        Some(deeper) => {
            found.push(before.clone());
            past_the_tree(deeper)
        }
        None => {
            found.push(before.clone());
            rest
        }
    };
    before.pop();
    rest
}

/// What follows a use tree whose names no longer matter.
fn past_the_tree(tree: &str) -> &str {
    let mut depth = 0_u32;
    for (at, c) in tree.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | ';' | '}' | ')' | '\n' if depth == 0 => return &tree[at..],
            _ => {}
        }
    }
    ""
}

/// Each function that has a body: its name, the line it begins on, and how many lines of code the body has.
pub(crate) fn functions(code: &str) -> Vec<(String, usize, usize)> {
    let mut found = Vec::new();
    for at in words(code, "fn") {
        let rest = &code[at + 2..];
        let name: String = rest
            .trim_start()
            .chars()
            .take_while(|&c| is_word(c))
            .collect();
        let Some(open) = rest.find(['{', ';']) else {
            continue;
        };
        if name.is_empty() || rest[open..].starts_with(';') && !rest[..open].contains('[') {
            continue; // a pointer type, or a function without a body
        }
        let Some(open) = rest.find('{') else {
            continue;
        };
        let body = &rest[open + 1..open + 1 + matching_brace(&rest[open + 1..])];
        let lines = body.lines().filter(|line| !line.trim().is_empty()).count();
        found.push((name, line_of(code, at), lines));
    }
    found
}

fn matching_brace(body: &str) -> usize {
    let mut depth = 1_u32;
    for (at, c) in body.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 1 => return at,
            '}' => depth -= 1,
            _ => {}
        }
    }
    body.len()
}
