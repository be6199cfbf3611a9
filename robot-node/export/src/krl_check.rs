//! A tokenizer and block checker of KRL: characters, names, parentheses, and blocks that are closed in order. It knows no types and
//! no declarations, and so it is not a grammar of KRL.

/// Most characters of a name in KRL.
const LONGEST_NAME: usize = 24;

/// A fault in a file.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("line {line}: {found}")]
pub struct KrlFault {
    /// Number of the line, from 1.
    pub line: usize,
    /// The fault and what was found.
    pub found: String,
}

/// Words that open a block, may come between its parts, and close it.
const BLOCKS: [(&str, &[&str], &str); 10] = [
    ("IF", &["ELSE"], "ENDIF"),
    ("WHILE", &[], "ENDWHILE"),
    ("REPEAT", &[], "UNTIL"),
    ("LOOP", &[], "ENDLOOP"),
    ("FOR", &[], "ENDFOR"),
    ("SWITCH", &["CASE", "DEFAULT"], "ENDSWITCH"),
    ("SPLINE", &[], "ENDSPLINE"),
    ("DEF", &[], "END"),
    ("DEFFCT", &[], "ENDFCT"),
    ("DEFDAT", &[], "ENDDAT"),
];

/// Words that a line of a kind must have besides its first.
const NEEDED: [(&str, &str); 4] = [("IF", "THEN"), ("FOR", "TO"), ("TRIGGER", "DO"), ("SIGNAL", "TO")];

/// Divides a line into tokens, without its comment.
fn tokens(line: &str) -> Result<Vec<&str>, String> {
    let mut tokens = Vec::new();
    let mut rest = line.trim_start();
    while let Some(first) = rest.chars().next() {
        let word =
            |character: char| character.is_ascii_alphanumeric() || matches!(character, '_' | '$' | '.');
        let len = match first {
            ';' => break,
            '\'' => rest[1..].find('\'').map(|end| end + 2).ok_or("a quoted number is not closed")?,
            '"' => rest[1..].find('"').map(|end| end + 2).ok_or("a text is not closed")?,
            _ if word(first) => rest.find(|character| !word(character)).unwrap_or(rest.len()),
            '=' | '<' | '>' if rest[1..].starts_with(['=', '>']) => 2,
            '=' | '<' | '>' | '+' | '-' | '*' | '/' | '(' | ')' | '[' | ']' | '{' | '}' | ',' | ':' | '#'
            | '&' => 1,
            other => return Err(format!("the character {other:?}")),
        };
        let (token, after) = rest.split_at(len);
        tokens.push(token);
        rest = after.trim_start();
    }
    Ok(tokens)
}

/// Checks one line's parentheses and names.
fn check_line(tokens: &[&str]) -> Result<(), String> {
    let mut open = Vec::new();
    for token in tokens {
        match *token {
            "(" | "[" | "{" => open.push(*token),
            ")" | "]" | "}" => {
                let pair = match open.pop() {
                    Some("(") => ")",
                    Some("[") => "]",
                    Some("{") => "}",
                    _ => return Err(format!("{token} closes nothing")),
                };
                if pair != *token {
                    return Err(format!("{token} where {pair} is needed"));
                }
            }
            name if name.split('.').any(|part| part.len() > LONGEST_NAME) => {
                return Err(format!("the name {name} has more than {LONGEST_NAME} characters"));
            }
            _ => {}
        }
    }
    if let Some(token) = open.pop() {
        return Err(format!("{token} is not closed"));
    }
    for pair in tokens.windows(2) {
        let operator =
            |token: &str| matches!(token, "=" | "==" | "<>" | "+" | "*" | "/" | "AND" | "OR" | "B_AND");
        if let [one, other] = pair
            && operator(one)
            && (operator(other) || matches!(*other, ")" | "," | "THEN" | "DO"))
        {
            return Err(format!("{other} after {one}"));
        }
    }
    match tokens.last() {
        Some(last) if matches!(*last, "=" | "==" | "<>" | "+" | "*" | "AND" | "OR" | "NOT" | ",") => {
            Err(format!("nothing after {last}"))
        }
        _ => Ok(()),
    }
}

/// Checks the text of a file.
///
/// # Errors
/// The first fault.
pub fn check(text: &str) -> Result<(), KrlFault> {
    let mut open: Vec<(usize, &str)> = Vec::new();
    for (line, content) in (1..).zip(text.lines()) {
        let fault = |found| KrlFault { line, found };
        if content.starts_with('&') {
            continue; // an attribute of the file
        }
        let tokens = tokens(content).map_err(fault)?;
        check_line(&tokens).map_err(fault)?;
        let first = tokens.iter().copied().find(|token| *token != "GLOBAL").unwrap_or("");
        if let Some((_, needed)) = NEEDED.iter().find(|(word, _)| *word == first)
            && !tokens.contains(needed)
        {
            return Err(fault(format!("{first} without {needed}")));
        }
        if BLOCKS.iter().any(|(opens, ..)| *opens == first) {
            open.push((line, first));
            continue;
        }
        let of_open = open.last().and_then(|(_, word)| BLOCKS.iter().find(|(opens, ..)| opens == word));
        if let Some((opens, _, closes)) = BLOCKS.iter().find(|(_, _, closes)| *closes == first) {
            if of_open.is_none_or(|(expected, ..)| expected != opens) {
                return Err(fault(format!("{closes} without {opens}")));
            }
            open.pop();
        } else if BLOCKS.iter().any(|(_, between, _)| between.contains(&first))
            && of_open.is_none_or(|(_, between, _)| !between.contains(&first))
        {
            return Err(fault(format!("{first} outside of its block")));
        } else if !first.is_empty() && open.is_empty() {
            return Err(fault(format!("{first} outside of a routine")));
        }
    }
    match open.pop() {
        Some((line, word)) => Err(KrlFault { line, found: format!("{word} is not closed") }),
        None => Ok(()),
    }
}
