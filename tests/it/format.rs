//! The number formats against vectors worked out from the register layout.

use pmac_dpram::format::{fixed48, float48, int24, write48};
use serde::Deserialize;

#[derive(Deserialize)]
struct Vectors {
    float48: Vec<Vector<f64>>,
    fixed48: Vec<Vector<i64>>,
}

#[derive(Deserialize)]
struct Vector<T> {
    value: T,
    #[serde(rename = "X")]
    x: String,
    #[serde(rename = "Y")]
    y: String,
    dpram_dwords: [String; 2],
    #[serde(rename = "write_L")]
    write_long: Option<[String; 2]>,
    decoded: Option<T>,
}

fn vectors() -> Vectors {
    serde_json::from_str(include_str!("../data/float48_vectors.json")).unwrap()
}

fn hex(text: &str) -> u32 {
    u32::from_str_radix(text, 16).unwrap()
}

fn pair(texts: &[String; 2]) -> [u32; 2] {
    [hex(&texts[0]), hex(&texts[1])]
}

#[test]
fn float_vectors_pass_both_ways() {
    let vectors = vectors().float48;
    assert_eq!(vectors.len(), 20);
    for vector in vectors {
        let dwords = pair(&vector.dpram_dwords);
        assert_eq!(dwords.map(int24::unsigned), [hex(&vector.y), hex(&vector.x)]);
        assert_eq!(float48::encode(vector.value), dwords, "{}", vector.value);
        let (decoded, expected) = (float48::decode(dwords[0], dwords[1]), vector.decoded.unwrap());
        // The JSON reader may miss the last bit of 53; the register has 36.
        assert!((decoded - expected).abs() <= expected.abs() * 2f64.powi(-50), "{decoded} {expected}");
        let written = pair(vector.write_long.as_ref().unwrap());
        assert_eq!(write48::pack(dwords), written, "{}", vector.value);
        assert_eq!(write48::unpack(written), dwords);
    }
}

#[test]
fn fixed_vectors_pass_both_ways() {
    let vectors = vectors().fixed48;
    assert_eq!(vectors.len(), 12);
    for vector in vectors {
        let dwords = pair(&vector.dpram_dwords);
        assert_eq!(dwords.map(int24::unsigned), [hex(&vector.y), hex(&vector.x)]);
        assert_eq!(fixed48::encode(vector.value), dwords);
        assert_eq!(fixed48::decode(dwords[0], dwords[1]), vector.value);
    }
}
