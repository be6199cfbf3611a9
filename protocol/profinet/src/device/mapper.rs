//! The device as its endpoint mapper: it tells where its RPC server is.

use super::Core;
use super::answers::Call;
use crate::rpc::{DEVICE_INTERFACE, Endpoint, Kind, MapperCall, MapperError, rpc_status};

impl Core {
    /// Answers a call of the endpoint mapper.
    pub(super) fn handle_lookup(&mut self, call: Call<'_>, body: &[u8]) {
        let Call { request: header, from, .. } = call;
        match MapperCall::parse(header, body) {
            Ok(asked) => {
                let address = self.station.ip().address;
                let endpoint = Endpoint::of(DEVICE_INTERFACE, &self.description, address);
                let answered = self.answers.answer_with(call, |body| asked.answer(&endpoint, body));
                self.count_overflow(answered);
            }
            Err(MapperError::Truncated(_)) => {
                self.counters.malformed += 1;
                self.reply(header, Kind::Fault, Some(rpc_status::PROTOCOL_ERROR), from);
            }
            Err(MapperError::Operation(_)) => {
                self.counters.foreign += 1;
                self.reply(header, Kind::Reject, Some(rpc_status::OPERATION_RANGE), from);
            }
        }
    }
}
