//! The page that shows all figures.

use std::fmt::Write;

use super::plan::{PRESETS, Plan, percentage};
use super::shot::DEFINITION;
use crate::quote;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:1200px;padding:0 1em;color:#222}\
h1{font-size:1.6em}h2{font-size:1.25em;margin-top:2.2em;border-top:1px solid #ccc;padding-top:.8em}\
img{max-width:100%;display:block}figure{margin:1em 0}figcaption{color:#555;font-size:.9em}\
figure.small{display:inline-block;max-width:48%;margin:.5em 1em .5em 0;vertical-align:top}\
table{border-collapse:collapse;margin:1em 0;font-size:.92em}th,td{padding:.2em .8em;border-bottom:1px solid #ddd;\
text-align:right}th:first-child,td:first-child{text-align:left}table.claims td{text-align:left;vertical-align:top}\
pre{background:#f4f4f4;padding:.6em;overflow-x:auto;font-size:.85em}\
.sheet{position:relative}.sheet img{width:100%}.sheet div{position:absolute;inset:0;display:grid;grid-auto-rows:1fr}\
.sheet span{color:#fff;font-size:clamp(7px,1vw,11.5px);line-height:1.2;padding:.25em .4em;text-shadow:0 0 3px #000}";

/// One figure of the page.
pub struct Section {
    title: String,
    body: String,
    claims: Vec<[String; 2]>,
    commands: Vec<String>,
}

impl Section {
    pub fn new(title: &str) -> Section {
        Section { title: title.into(), body: String::new(), claims: Vec::new(), commands: Vec::new() }
    }

    pub fn text(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", quote::html(text));
    }

    /// A statement of the paper and what is measured here.
    pub fn claim(&mut self, paper: &str, here: &str) {
        self.claims.push([paper.into(), here.into()]);
    }

    pub fn image(&mut self, file: &str, caption: &str) {
        self.figure("", file, caption);
    }

    /// Two of these stand side by side.
    pub fn small_image(&mut self, file: &str, caption: &str) {
        self.figure(" class=\"small\"", file, caption);
    }

    fn figure(&mut self, class: &str, file: &str, caption: &str) {
        let (source, caption) = (url(file), quote::html(caption));
        let image = format!("<img src=\"{source}\" alt=\"{caption}\">");
        let _ = writeln!(self.body, "<figure{class}>{image}<figcaption>{caption}</figcaption></figure>");
    }

    /// A contact sheet of equal tiles with a label over each.
    pub fn sheet(&mut self, file: &str, description: &str, columns: usize, labels: &[String]) {
        let spans: String = labels.iter().map(|l| format!("<span>{}</span>", quote::html(l))).collect();
        // Rows without labels at the end keep their height.
        let rows = labels.len().div_ceil(columns.max(1)).max(1);
        let _ = writeln!(
            self.body,
            "<div class=\"sheet\"><img src=\"{}\" alt=\"{}\"><div style=\"grid-template:repeat({rows},1fr)/\
             repeat({columns},1fr)\">{spans}</div></div>",
            url(file),
            quote::html(description)
        );
    }

    pub fn html(&mut self, html: &str) {
        self.body.push_str(html);
    }

    pub fn files(&mut self, files: &[&str]) {
        let links: Vec<String> = files.iter().map(|f| format!("<a href=\"{0}\">{0}</a>", url(f))).collect();
        let _ = writeln!(self.body, "<p>Figures as CSV: {}</p>", links.join(", "));
    }

    /// A command line that repeats it.
    pub fn command(&mut self, line: &str) {
        self.commands.push(line.into());
    }
}

/// The page as it grows.
pub struct Page {
    head: String,
    sections: Vec<Section>,
}

impl Page {
    pub fn new(plan: &Plan, left_out: &[String]) -> Page {
        let presets: Vec<&str> = PRESETS.iter().map(|p| p.0).collect();
        let ratios: Vec<String> = plan.ratios.iter().map(|r| percentage(*r)).collect();
        let mut head = format!(
            "<h1>Measured BRDFs from few samples</h1>\n<p>The study of Seylan, Ergun, Ozturk, &quot;BRDF Reconstruction \
             Using Compressive Sensing&quot; (WSCG 2013), repeated by csbrdf {} on {} tables. Presets: {}. Ratios: {}. \
             Seed {}.</p>\n<p>{DEFINITION}</p>\n<pre>{}</pre>\n",
            env!("CARGO_PKG_VERSION"),
            plan.materials.len(),
            presets.join(", "),
            ratios.join(", "),
            plan.seed,
            quote::html(&plan.command)
        );
        if !left_out.is_empty() {
            let _ = writeln!(
                head,
                "<p><strong>Left out, could not be read: {}</strong></p>",
                quote::html(&left_out.join(", "))
            );
        }
        Page { head, sections: Vec::new() }
    }

    pub fn add(&mut self, section: Section) {
        self.sections.push(section);
    }

    pub fn finish(self, seconds: f64) -> String {
        let mut text = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
             content=\"width=device-width\"><title>csbrdf study</title><style>{STYLE}</style></head><body>\n{}",
            self.head
        );
        let claims: Vec<&[String; 2]> = self.sections.iter().flat_map(|s| &s.claims).collect();
        if !claims.is_empty() {
            text.push_str("<table class=\"claims\"><tr><th>the paper</th><th>here</th></tr>\n");
            for [paper, here] in claims {
                let _ = writeln!(text, "<tr><td>{}</td><td>{}</td></tr>", quote::html(paper), quote::html(here));
            }
            text.push_str("</table>\n");
        }
        for section in &self.sections {
            let _ = writeln!(text, "<h2>{}</h2>\n{}", quote::html(&section.title), section.body);
            if !section.commands.is_empty() {
                let _ = writeln!(text, "<pre>{}</pre>", quote::html(&section.commands.join("\n")));
            }
        }
        let _ = writeln!(text, "<p>Made in {seconds:.0} s.</p>\n</body></html>");
        text
    }
}

/// A table of text cells under a head.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
        cells.map(|c| format!("<{tag}>{}</{tag}>", quote::html(c))).collect()
    };
    let mut html = format!("<table><tr>{}</tr>\n", cells("th", &mut head.iter().copied()));
    for row in rows {
        let _ = writeln!(html, "<tr>{}</tr>", cells("td", &mut row.iter().map(String::as_str)));
    }
    html + "</table>\n"
}

/// A file name as a relative address.
fn url(file: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
    file.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(quote::html("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
        assert_eq!(url("a b<\u{e9}>.png"), "a%20b%3C%C3%A9%3E.png");
        assert!(table(&["x"], &[vec!["<1>".into()]]).contains("<td>&lt;1&gt;</td>"));
    }
}
