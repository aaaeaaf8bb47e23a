//! Encodes a MERL `.binary` table: `cargo run --release --features encode --example encode -- IN.binary OUT.csbrdf`.

use std::path::Path;

use csbrdf::{Contract, Encoder, Error, Result};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = &arguments[..] else {
        return Err(Error::InvalidArgument("give a table and the file to write".into()));
    };
    let bytes = std::fs::read(input).map_err(|e| Error::from(e).in_file(input))?;
    let table = csbrdf::io::merl::read_merl(&bytes).map_err(|e| e.in_file(input))?;
    // Root mean square error of ln(f + .001) over the measured entries: some one per cent.
    let encoded = Encoder::new().contract(Contract::Rmse(0.01)).encode(&table)?;
    std::fs::write(Path::new(output), &encoded.bytes)?;
    println!("{} bytes, log rms {:.4}", encoded.bytes.len(), encoded.report.log_rms);
    Ok(())
}
