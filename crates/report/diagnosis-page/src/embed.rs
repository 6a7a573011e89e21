//! Pictures as data URIs: JPEG in base64 (RFC 4648), so that a page needs no file beside it.

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
const QUALITY: u8 = 88;

/// Returns a picture as a data URI; `None` if it has no pixels.
pub(crate) fn jpeg(picture: &RgbImage) -> Option<String> {
    let mut bytes = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY)).ok()?;
    Some(format!("data:image/jpeg;base64,{}", base64(&bytes)))
}

/// Returns bytes in base64 with padding.
fn base64(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = (0..3).fold(0, |word, k| word << 8 | u32::from(chunk.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k) & 63) as usize];
            out.push(if k <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_follows_its_standard() {
        // test vectors of RFC 4648, section 10
        for (text, expected) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(text.as_bytes()), expected);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn pictures_come_back() {
        use image::ImageReader;
        let uri = jpeg(&RgbImage::from_pixel(6, 4, image::Rgb([200, 30, 30]))).expect("a picture");
        let digits = uri.strip_prefix("data:image/jpeg;base64,").expect("a data URI");
        let mut bytes = Vec::new();
        let (mut word, mut bits) = (0_u32, 0);
        for c in digits.bytes().filter(|c| *c != b'=') {
            word = word << 6 | DIGITS.iter().position(|d| *d == c).expect("a digit") as u32;
            bits += 6;
            if bits >= 8 {
                bits -= 8;
                bytes.push((word >> bits & 255) as u8);
            }
        }
        let reader = ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().expect("a format");
        let picture = reader.decode().expect("a picture").to_rgb8();
        assert_eq!(picture.dimensions(), (6, 4));
        assert!(picture.get_pixel(3, 2).0[0] > 180);
    }
}
