//! Lays out compact JSON for people: one field a line, lists of numbers and small objects on one line.
//!
//! Works on text that a serialiser made; a change of one track or lane is a change of few lines.

/// How long an object may be to stay on one line, in bytes.
const LINE_BYTES: usize = 120;

/// Returns the laid out text of compact, valid JSON.
pub(crate) fn lay_out(compact: &str) -> String {
    let bytes = compact.as_bytes();
    let mut out = String::with_capacity(compact.len() + compact.len() / 8);
    let close = closings(bytes);
    value(compact, &close, (0, bytes.len()), (&mut out, 0));
    out.push('\n');
    out
}

/// Returns for each opening bracket the position of its closing one, 0 elsewhere.
fn closings(bytes: &[u8]) -> Vec<usize> {
    let mut close = vec![0; bytes.len()];
    let mut open = Vec::new();
    let mut i = 0;
    while i < bytes.len() {
        match bytes[i] {
            b'"' => i = end_of_string(bytes, i),
            b'{' | b'[' => open.push(i),
            b'}' | b']' => {
                if let Some(start) = open.pop() {
                    close[start] = i;
                }
            }
            _ => {}
        }
        i += 1;
    }
    close
}

fn end_of_string(bytes: &[u8], start: usize) -> usize {
    let mut i = start + 1;
    while i < bytes.len() && bytes[i] != b'"' {
        i += if bytes[i] == b'\\' { 2 } else { 1 };
    }
    i
}

/// Lays out the value between two positions.
fn value(text: &str, close: &[usize], span: (usize, usize), out: (&mut String, usize)) {
    let (start, end) = span;
    let (out, indent) = out;
    let bytes = text.as_bytes();
    let inner = &text[start..end];
    let container = matches!(bytes[start], b'{' | b'[');
    let small = if bytes[start] == b'[' {
        !inner.contains('{') && !inner.starts_with("[[[")
    } else {
        inner.len() <= LINE_BYTES && !inner[1..].contains(['{', '['])
    };
    if !container || small || end - start <= 2 {
        spaced(inner, out);
        return;
    }
    out.push(char::from(bytes[start]));
    let mut at = start + 1;
    let mut first = true;
    while at < end - 1 {
        let stop = item_end(bytes, close, at, end - 1);
        out.push_str(if first { "\n" } else { ",\n" });
        out.push_str(&" ".repeat(indent + 2));
        first = false;
        if bytes[start] == b'{' {
            let key_end = end_of_string(bytes, at) + 1;
            out.push_str(&text[at..key_end]);
            out.push_str(": ");
            at = key_end + 1;
        }
        value(text, close, (at, stop), (out, indent + 2));
        at = stop + 1;
    }
    out.push('\n');
    out.push_str(&" ".repeat(indent));
    out.push(char::from(bytes[end - 1]));
}

/// Returns where the item (or field) that begins at a position ends.
fn item_end(bytes: &[u8], close: &[usize], start: usize, limit: usize) -> usize {
    let mut i = start;
    while i < limit && bytes[i] != b',' {
        match bytes[i] {
            b'"' => i = end_of_string(bytes, i),
            b'{' | b'[' => i = close[i],
            _ => {}
        }
        i += 1;
    }
    i
}

/// Adds text on one line, a space after each comma and colon outside strings; inner pairs stay close.
fn spaced(text: &str, out: &mut String) {
    let bytes = text.as_bytes();
    let (mut i, mut from, mut depth) = (0, 0, 0);
    while i < bytes.len() {
        match bytes[i] {
            b'"' => i = end_of_string(bytes, i),
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth -= 1,
            b':' => {
                out.push_str(&text[from..=i]);
                out.push(' ');
                from = i + 1;
            }
            b',' if depth < 2 => {
                out.push_str(&text[from..=i]);
                out.push(' ');
                from = i + 1;
            }
            _ => {}
        }
        i += 1;
    }
    out.push_str(&text[from..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(compact: &str, expected: &str) {
        let laid_out = lay_out(compact);
        assert_eq!(laid_out, expected);
        let value: serde_json::Value = serde_json::from_str(&laid_out).expect("the layout is JSON");
        let before: serde_json::Value = serde_json::from_str(compact).expect("the input is JSON");
        assert_eq!(value, before);
    }

    #[test]
    fn keeps_numbers_on_one_line_and_objects_apart() {
        check("{}", "{}\n");
        check(r#"{"a":[1,2],"b":"x,{\"[y"}"#, "{\n  \"a\": [1, 2],\n  \"b\": \"x,{\\\"[y\"\n}\n");
        check(r#"{"a":1,"b":"x,y"}"#, "{\"a\": 1, \"b\": \"x,y\"}\n");
        check(
            r#"[{"p":[[1,2],[3,4]],"n":null},{"p":[]}]"#,
            "[\n  {\n    \"p\": [[1,2], [3,4]],\n    \"n\": null\n  },\n  {\n    \"p\": []\n  }\n]\n",
        );
    }
}
