//! Values of a script over time, written into the inputs.

use machine::{Duration, Instant};

use crate::image::Image;
use crate::script::{ScriptError, ScriptedInput, ValueType};

/// Input whose place is known.
#[derive(Clone, Debug)]
pub(crate) struct PlacedInput {
    pub(crate) input: ScriptedInput,
    /// First bit in the inputs.
    bit: usize,
    /// Bits that it has there.
    bits: usize,
    /// First byte of the echoed outputs.
    echo: Option<usize>,
}

impl PlacedInput {
    /// Finds the places of an input.
    ///
    /// # Errors
    ///
    /// The device does not have the place, or the value does not fit into it.
    pub(crate) fn new(input: ScriptedInput, inputs: &Image, outputs: &Image) -> Result<Self, ScriptError> {
        input.check()?;
        let list = |image: &Image| {
            let names: Vec<_> = image.places.iter().map(|place| place.place.as_str()).take(24).collect();
            if names.is_empty() { "none".to_owned() } else { names.join(", ") }
        };
        let unknown = |name: &str, image: &Image| {
            ScriptError::new(format!("place `{name}` is not in the device; choose from {}", list(image)))
        };
        let place = inputs.place(&input.place).ok_or_else(|| unknown(&input.place, inputs))?;
        let offset = 8 * input.byte as usize + usize::from(input.bit);
        let rest = place.bits.saturating_sub(offset);
        let bits = match input.value_type {
            Some(ValueType::Bool) => 1,
            // An entry of a few bits takes the lowest ones of a number.
            Some(value_type) if offset == 0 && place.bits < 8 * value_type.bytes() => place.bits,
            Some(value_type) => 8 * value_type.bytes(),
            None => rest,
        };
        if bits == 0 || bits > rest {
            let (name, byte) = (&input.place, input.byte);
            let fault = format!(
                "{bits} bits from byte {byte} of `{name}`, which has {} bits; correct the byte",
                place.bits
            );
            return Err(ScriptError::new(fault));
        }
        let (bit, mut bits) = (place.bit + offset, bits);
        let echo = match &input.echo {
            None => None,
            Some(echo) => {
                let source = outputs.place(&echo.place).ok_or_else(|| unknown(&echo.place, outputs))?;
                let from = source.bit + 8 * echo.byte as usize;
                bits = bits.min((source.bit + source.bits).saturating_sub(from));
                if bits == 0
                    || (input.value_type.is_some_and(|it| it != ValueType::Bool && bits < 8 * it.bytes()))
                {
                    let (name, byte) = (&echo.place, echo.byte);
                    let fault = format!(
                        "byte {byte} of outputs `{name}`, which has {} bits; correct the byte",
                        source.bits
                    );
                    return Err(ScriptError::new(fault));
                }
                Some(from)
            }
        };
        Ok(Self { input, bit, bits, echo })
    }

    /// Returns whether it writes the same bits as another one.
    pub(crate) fn is_at(&self, other: &Self) -> bool {
        (self.bit, self.bits) == (other.bit, other.bits)
    }

    /// Writes the value of an instant.
    pub(crate) fn write(&self, start: Instant, now: Instant, inputs: &mut Image, outputs: &Image) {
        if let Some(from) = self.echo {
            for index in 0..self.bits {
                let bit = from + index;
                let is_set = outputs.bytes.get(bit / 8).is_some_and(|byte| byte & 1 << (bit % 8) != 0);
                inputs.write_bits(self.bit + index, 1, &[u8::from(is_set)]);
            }
            return;
        }
        let seconds = now.since(start).as_secs_f64();
        let mut bytes = [0; 8];
        let len = encode(
            self.input.value_type.unwrap_or(ValueType::Uint8),
            self.input.value_at(seconds),
            &mut bytes,
        );
        // Bits of an entry are counted from the lowest one; a number in bytes has the order of the bus.
        if inputs.is_big_endian
            && self.bits == 8 * len
            && let Some(number) = bytes.get_mut(..len)
        {
            number.reverse();
        }
        inputs.write_bits(self.bit, self.bits, &bytes);
    }
}

/// Writes a value with its lowest byte first and returns its length. A whole number wraps around at the end of its type.
fn encode(value_type: ValueType, value: f64, bytes: &mut [u8; 8]) -> usize {
    // Numbers above 2^63 saturate, far beyond the types that there are.
    let whole = value.round() as i64;
    *bytes = match value_type {
        ValueType::Bool => [u8::from(value != 0.0), 0, 0, 0, 0, 0, 0, 0],
        ValueType::Real32 => u64::from((value as f32).to_bits()).to_le_bytes(),
        ValueType::Real64 => value.to_le_bytes(),
        _ => whole.to_le_bytes(),
    };
    value_type.bytes()
}

/// Returns a time of a script as an instant.
pub(crate) fn instant(start: Instant, seconds: f64) -> Instant {
    start + Duration::from_secs_f64(seconds.max(0.0))
}
