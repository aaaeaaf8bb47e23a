//! The text of a trace, from arbitrary bytes: read or refused; what was read comes back from its text.

use csbrdf::brdf::touched::Touched;

pub fn run(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let Ok(touched) = Touched::from_text(&text) else { return };
    let again = Touched::from_text(&touched.to_text()).expect("its own text");
    assert_eq!(again, touched);
    let mut merged = again;
    merged.merge(&touched).expect("a trace of the same file");
    assert!(merged == touched && touched.count() <= touched.blocks().len());
}
