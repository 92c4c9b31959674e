//! Protocol Buffers encoder for Foxglove messages, with fields given by number.
//! <https://protobuf.dev/programming-guides/encoding/>

/// Encoded message.
#[derive(Default)]
pub(super) struct Message(pub Vec<u8>);

impl Message {
    /// Appends a field of type `double`.
    pub(super) fn double(self, field: u64, value: f64) -> Self {
        self.tag(field, 1).raw(&value.to_le_bytes())
    }

    /// Appends a field of type `fixed32`.
    pub(super) fn fixed32(self, field: u64, value: u32) -> Self {
        self.tag(field, 5).raw(&value.to_le_bytes())
    }

    /// Appends an unsigned integer or enum field.
    pub(super) fn whole(self, field: u64, value: u64) -> Self {
        self.tag(field, 0).varint(value)
    }

    /// Appends a `bytes` or `string` field.
    pub(super) fn bytes(self, field: u64, bytes: &[u8]) -> Self {
        self.tag(field, 2).varint(bytes.len() as u64).raw(bytes)
    }

    /// Appends an embedded message as a field.
    pub(super) fn message(self, field: u64, message: &Self) -> Self {
        self.bytes(field, &message.0)
    }

    fn tag(self, field: u64, wire_type: u64) -> Self {
        self.varint(field << 3 | wire_type)
    }

    fn varint(mut self, mut value: u64) -> Self {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
        self
    }

    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_encoded_as_in_the_examples_of_the_specification() {
        assert_eq!(Message::default().whole(1, 150).0, [0x08, 0x96, 0x01]);
        let text = [0x12, 0x07, 0x74, 0x65, 0x73, 0x74, 0x69, 0x6e, 0x67];
        assert_eq!(Message::default().bytes(2, b"testing").0, text);
        let inner = Message::default().whole(1, 150);
        assert_eq!(Message::default().message(3, &inner).0, [0x1a, 0x03, 0x08, 0x96, 0x01]);
    }
}
