//! MCAP, the container format of Foxglove and Rerun: messages with their schemas in one uncompressed, indexed chunk.
//! <https://mcap.dev/spec>

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const LIBRARY: &str = concat!("trilink ", env!("CARGO_PKG_VERSION"));
const ENCODING: &str = "protobuf";
/// Name in the compression field of an uncompressed chunk.
const UNCOMPRESSED: &str = "";

/// Topic, with the schema of its messages.
pub(super) struct Channel {
    pub topic: &'static str,
    pub schema: &'static str,
    /// Schema as a `FileDescriptorSet`.
    pub description: &'static [u8],
}

/// Encoded message of a channel.
pub(super) struct Message {
    /// Index of the message's channel.
    pub channel: u16,
    pub sequence: u32,
    pub time_ns: u64,
    pub data: Vec<u8>,
}

/// Buffer for the content of one or several records.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn u16(self, value: u16) -> Self {
        self.raw(&value.to_le_bytes())
    }

    fn u32(self, value: u32) -> Self {
        self.raw(&value.to_le_bytes())
    }

    fn u64(self, value: u64) -> Self {
        self.raw(&value.to_le_bytes())
    }

    /// Appends a string, list or map, preceded by its length in bytes.
    fn sized(self, bytes: &[u8]) -> Self {
        self.u32(bytes.len() as u32).raw(bytes)
    }

    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    /// Appends a record with the given opcode.
    fn record(self, kind: u8, content: &Self) -> Self {
        self.raw(&[kind]).u64(content.0.len() as u64).raw(&content.0)
    }

    fn len(&self) -> u64 {
        self.0.len() as u64
    }
}

/// Returns the content of an MCAP file with the messages in their given order. The ids of a channel and of its schema
/// are the channel's index plus one.
pub(super) fn mcap(channels: &[Channel], messages: impl Iterator<Item = Message>) -> Vec<u8> {
    let mut known = Bytes::default();
    for (channel, id) in channels.iter().zip(1..) {
        let schema = Bytes::default().u16(id).sized(channel.schema.as_bytes());
        let schema = schema.sized(ENCODING.as_bytes()).sized(channel.description);
        let channel = Bytes::default().u16(id).u16(id).sized(channel.topic.as_bytes());
        let channel = channel.sized(ENCODING.as_bytes()).sized(&[]);
        known = known.record(0x03, &schema).record(0x04, &channel);
    }
    let known = known.0;
    let mut records = Bytes::default().raw(&known);
    let mut indices: Vec<Bytes> = channels.iter().map(|_| Bytes::default()).collect();
    let mut count = 0_u64;
    let mut span_ns = [u64::MAX, 0];
    for Message { channel, sequence, time_ns, data } in messages {
        if let Some(index) = indices.get_mut(usize::from(channel)) {
            *index = std::mem::take(index).u64(time_ns).u64(records.len());
        }
        let message = Bytes::default().u16(channel + 1).u32(sequence).u64(time_ns).u64(time_ns);
        records = records.record(0x05, &message.raw(&data));
        count += 1;
        span_ns = [span_ns[0].min(time_ns), span_ns[1].max(time_ns)];
    }
    let [first_ns, last_ns] = [span_ns[0].min(span_ns[1]), span_ns[1]];
    let size = records.len();
    // A checksum of 0 means that there is none.
    let chunk = Bytes::default().u64(first_ns).u64(last_ns).u64(size).u32(0);
    let chunk = chunk.sized(UNCOMPRESSED.as_bytes()).u64(size).raw(&records.0);

    let header = Bytes::default().sized(b"").sized(LIBRARY.as_bytes());
    let mut file = Bytes::default().raw(MAGIC).record(0x01, &header);
    let chunk_at = file.len();
    file = file.record(0x06, &chunk);
    let indices_at = file.len();
    let mut offsets = Bytes::default();
    let mut counts = Bytes::default();
    for (index, id) in indices.iter().zip(1..) {
        offsets = offsets.u16(id).u64(file.len());
        counts = counts.u16(id).u64(index.len() / 16);
        file = file.record(0x07, &Bytes::default().u16(id).sized(&index.0));
    }
    let chunk_index = Bytes::default().u64(first_ns).u64(last_ns).u64(chunk_at);
    let chunk_index = chunk_index.u64(indices_at - chunk_at).sized(&offsets.0);
    let chunk_index = chunk_index.u64(file.len() - indices_at).sized(UNCOMPRESSED.as_bytes());
    let number = channels.len();
    let statistics = Bytes::default().u64(count).u16(number as u16).u32(number as u32);
    let statistics = statistics.u32(0).u32(0).u32(1).u64(first_ns).u64(last_ns).sized(&counts.0);
    file = file.record(0x0f, &Bytes::default().u32(0));
    let footer = Bytes::default().u64(file.len()).u64(0).u32(0);
    file.raw(&known)
        .record(0x0b, &statistics)
        .record(0x08, &chunk_index.u64(size).u64(size))
        .record(0x02, &footer)
        .raw(MAGIC)
        .0
}
