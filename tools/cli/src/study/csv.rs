//! Tables as text (RFC 4180).

use crate::quote::csv;

/// Rows of fields under a head.
pub struct Csv(String);

impl Csv {
    pub fn new(head: &str) -> Csv {
        Csv(format!("{head}\n"))
    }

    /// Adds a row.
    pub fn row(&mut self, fields: &[String]) {
        let fields: Vec<_> = fields.iter().map(|field| csv(field)).collect();
        self.0 += &fields.join(",");
        self.0.push('\n');
    }

    pub fn bytes(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

/// A figure with `decimals`; empty where there is none, `inf` for equal pictures.
pub fn figure(value: impl Into<Option<f64>>, decimals: usize) -> String {
    value.into().map_or(String::new(), |v| format!("{v:.decimals$}"))
}
