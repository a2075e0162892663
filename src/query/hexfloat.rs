//! Floats as text that loses no bit: the hexadecimal form of C99 (`%a`), as in `0x1.8p+1` for 3.

/// The text of a float.
pub fn format(x: f32) -> String {
    let sign = if x.is_sign_negative() { "-" } else { "" };
    if !x.is_finite() {
        return format!("{sign}{}", if x.is_nan() { "nan" } else { "inf" });
    }
    let bits = x.to_bits();
    let (exponent, fraction) = ((bits >> 23 & 0xff) as i32, bits & 0x7f_ffff);
    let (lead, exponent) = match (exponent, fraction) {
        (0, 0) => (0, 0),
        (0, _) => (0, -126),
        _ => (1, exponent - 127),
    };
    // 23 bits fill six digits but for one bit.
    let digits = format!("{:06x}", fraction << 1);
    let digits = digits.trim_end_matches('0');
    let point = if digits.is_empty() { "" } else { "." };
    format!("{sign}0x{lead}{point}{digits}p{exponent:+}")
}

/// The float that a text means, in hexadecimal or as Rust writes it; `None` if it is neither.
pub fn parse(text: &str) -> Option<f32> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text),
    };
    let Some(hex) = digits.strip_prefix("0x") else { return text.parse().ok() };
    let (mantissa, exponent) = hex.split_once('p')?;
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = format!("{whole}{fraction}");
    // As many as f64 holds; from_str_radix would take a sign.
    if digits.len() > 13 || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let value = u64::from_str_radix(&digits, 16).ok()? as f64;
    let exponent: i32 = exponent.parse().ok().filter(|e| (-1000..=1000).contains(e))?;
    Some((sign * value * f64::from(exponent - 4 * fraction.len() as i32).exp2()) as f32)
}

#[cfg(test)]
mod tests {
    use super::{format, parse};

    #[test]
    fn known_floats() {
        let known = [
            (0.0, "0x0p+0"),
            (-0.0, "-0x0p+0"),
            (3.0, "0x1.8p+1"),
            (-0.1, "-0x1.99999ap-4"),
            (f32::MAX, "0x1.fffffep+127"),
            (f32::MIN_POSITIVE, "0x1p-126"),
            (f32::from_bits(1), "0x0.000002p-126"),
            (f32::INFINITY, "inf"),
        ];
        for (x, text) in known {
            assert_eq!(format(x), text);
            assert_eq!(parse(text).map(f32::to_bits), Some(x.to_bits()), "{text}");
        }
        assert_eq!(parse("0.25"), Some(0.25));
        for bad in
            ["", "0x", "0xp+1", "0x1", "0x1p", "0x1p+99999", "0x+1p+0", "0x12345678901234p+0", "0x1.gp+0"]
        {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn no_bit_is_lost() {
        for bits in (0..u32::MAX).step_by(65_537) {
            let x = f32::from_bits(bits);
            if x.is_finite() {
                assert_eq!(parse(&format(x)).map(f32::to_bits), Some(bits));
            }
        }
    }
}
