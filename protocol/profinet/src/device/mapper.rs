//! The device as its endpoint mapper: it tells where its RPC server is.

use super::Core;
use super::answers::Call;
use crate::RPC_PORT;
use crate::rpc::{Kind, LOOKUP, LOOKUP_HANDLE_FREE, Lookup, object, rpc_status};
use machine::wire::{BigEndian, Writer};

impl Core {
    /// Answers a call of the endpoint mapper.
    pub(super) fn handle_lookup(&mut self, call: Call<'_>, body: &[u8]) {
        let Call { request: header, from, .. } = call;
        let answered = match (header.operation, Lookup::parse(header, body)) {
            (LOOKUP, Ok(lookup)) => {
                let object = object(1, self.description.identity);
                let (description, address) = (&self.description, self.station.ip().address);
                self.answers
                    .answer_with(call, |body| lookup.answer(object, description, RPC_PORT, address, body))
            }
            // The returned handle is nil, because there was nothing to free.
            (LOOKUP_HANDLE_FREE, _) => self.answers.answer_with(call, |body| {
                let mut writer = Writer::<BigEndian>::new(body);
                writer.zeros(24);
                writer.finish()
            }),
            (LOOKUP, Err(_)) => {
                self.counters.malformed += 1;
                return self.reply(header, Kind::Fault, Some(rpc_status::PROTOCOL_ERROR), from);
            }
            _ => {
                self.counters.foreign += 1;
                return self.reply(header, Kind::Reject, Some(rpc_status::OPERATION_RANGE), from);
            }
        };
        self.count_overflow(answered);
    }
}
