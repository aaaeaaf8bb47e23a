//! A file as its sections, to change one and put them together again with right lengths.

const PREAMBLE: usize = 32;
const ENTRY: usize = 20;
const END_MARKER: [u8; 8] = *b"CSBRDF.\n";

/// One section: identifier and flags as they stand in the table, and its bytes.
#[derive(Clone)]
pub struct Section {
    pub head: [u8; 8],
    pub bytes: Vec<u8>,
    pub crc: [u8; 4],
}

impl Section {
    pub fn id(&self) -> &[u8] {
        &self.head[..4]
    }
}

/// Preamble and sections; `None` if the lengths do not fit the file.
pub fn split(file: &[u8]) -> Option<(&[u8], Vec<Section>)> {
    let preamble = file.get(..PREAMBLE)?;
    let count = usize::from(u16::from_le_bytes([preamble[14], preamble[15]]));
    let mut at = PREAMBLE + count * ENTRY;
    let mut sections = Vec::new();
    for entry in file.get(PREAMBLE..at)?.chunks_exact(ENTRY) {
        let length = usize::try_from(u64::from_le_bytes(entry[8..16].try_into().ok()?)).ok()?;
        let bytes = file.get(at..at.checked_add(length)?)?.to_vec();
        at += length;
        sections.push(Section { head: entry[..8].try_into().ok()?, bytes, crc: entry[16..].try_into().ok()? });
    }
    (file.len() == at + END_MARKER.len()).then_some((preamble, sections))
}

/// The file of a preamble and sections, lengths and count corrected.
pub fn join(preamble: &[u8], sections: &[Section]) -> Vec<u8> {
    let body: usize = sections.iter().map(|s| s.bytes.len()).sum();
    let length = PREAMBLE + sections.len() * ENTRY + body + END_MARKER.len();
    let mut file = preamble.to_vec();
    file[14..16].copy_from_slice(&(sections.len() as u16).to_le_bytes());
    file[16..24].copy_from_slice(&(length as u64).to_le_bytes());
    for section in sections {
        file.extend(section.head);
        file.extend((section.bytes.len() as u64).to_le_bytes());
        file.extend(section.crc);
    }
    sections.iter().for_each(|section| file.extend(&section.bytes));
    file.extend(END_MARKER);
    file
}
