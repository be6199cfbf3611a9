//! Services of the Connection Manager by which others see who has which connection (volume 1, 3-5.5).

use super::establish::in_their_places;
use super::state::State;
use crate::cip::{Path, Violation, service};
use crate::connection::{ConnectionData, Triad};
use crate::{Reader, Writer};

impl State {
    /// Executes one of the services.
    pub(super) fn diagnose(
        &self,
        service: u8,
        data: &[u8],
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        match service {
            service::GET_CONNECTION_DATA => self.connection_data(data, writer),
            service::SEARCH_CONNECTION_DATA => self.search_connection(data, writer),
            service::GET_CONNECTION_OWNER => self.connection_owner(data, writer),
            _ => Err(Violation::UnknownService),
        }
    }

    fn open_connections(&self) -> impl Iterator<Item = &ConnectionData> {
        self.io.data().chain(self.explicit.data())
    }

    /// Returns the smallest number that no open connection has, from 1.
    pub(super) fn fresh_number(&self) -> u16 {
        let is_free = |number: &u16| self.open_connections().all(|open| open.number != *number);
        (1..=u16::MAX).find(is_free).unwrap_or(u16::MAX)
    }

    /// Writes the data of the connection with a number: Get_Connection_Data. The request is that number, a u16.
    fn connection_data(&self, data: &[u8], writer: &mut Writer<'_>) -> Result<(), Violation> {
        let mut reader = Reader::new(data);
        let number = reader.u16().map_err(|_| Violation::TooShort)?;
        if !reader.is_empty() {
            return Err(Violation::TooLong);
        }
        let found = self.open_connections().find(|open| open.number == number);
        found.ok_or(Violation::UnknownObject)?.emit(writer);
        Ok(())
    }

    /// Writes the data of the connection with a triad: Search_Connection_Data. The request is connection serial number, vendor
    /// and serial number of the originator.
    fn search_connection(&self, data: &[u8], writer: &mut Writer<'_>) -> Result<(), Violation> {
        let mut reader = Reader::new(data);
        let triad = Triad::parse(&mut reader).map_err(|_| Violation::TooShort)?;
        if !reader.is_empty() {
            return Err(Violation::TooLong);
        }
        let found = self.open_connections().find(|open| open.triad == triad);
        found.ok_or(Violation::UnknownObject)?.emit(writer);
        Ok(())
    }

    /// Says who owns the outputs of a path: Get_Connection_Owner (volume 1, 3-5.5).
    ///
    /// ```text
    /// request  0      reserved                   u8
    ///          1      connection path size       u8, words
    ///          2..    connection path
    /// reply    0      connections                u8
    ///          1      of several originators     u8, 0: this device has none
    ///          2      of redundant owners        u8, 0: this device has none
    ///          3      last action                u8, 0 no owner, 1 owner is idle, 2 owner is in run
    ///          4..12  connection serial number, vendor and serial number of the owner; zeros without one
    /// ```
    fn connection_owner(&self, data: &[u8], writer: &mut Writer<'_>) -> Result<(), Violation> {
        let mut reader = Reader::new(data);
        let read = |_| Violation::TooShort;
        reader.skip(1).map_err(read)?;
        let words = reader.u8().map_err(read)?;
        let path = reader.bytes(usize::from(words) * 2).map_err(read)?;
        let points = Path(path).application().map_err(|_| Violation::UnknownObject)?.points;
        let [_, consumed, _] = in_their_places(points);
        let owner = consumed.and_then(|consumed| self.io.owner_of(consumed));
        let action = owner.map_or(0, |owner| if owner.run { 2 } else { 1 });
        writer.bytes(&[owner.is_some().into(), 0, 0, action]);
        owner.map(|owner| owner.triad).unwrap_or_default().emit(writer);
        Ok(())
    }
}
