use crate::{Bus, Urb};

/// A USB device's side of the cable. Standard requests are answered from the descriptors; the rest comes here.
pub trait Device: Send {
    /// What the device says of itself.
    fn descriptors(&self) -> Descriptors;

    /// How fast it is.
    fn speed(&self) -> Speed;

    /// A class or vendor request to endpoint 0; `data` is what the host sends with it. Returns what the host gets.
    fn control(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall>;

    /// A transfer on any other endpoint. It may be completed on `bus` at once, or kept and completed later, from any thread. One that the
    /// kernel has taken back meanwhile is refused by `bus`, which says so: what it carried has not arrived.
    fn transfer(&mut self, urb: Urb, bus: &Bus);
}

/// Descriptors as they go over the wire (USB 2.0, chapter 9).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptors {
    /// The device descriptor, 18 bytes.
    pub device: Vec<u8>,
    /// The one configuration with its interfaces, endpoints and class descriptors.
    pub configuration: Vec<u8>,
    /// Strings 1, 2, ... in English.
    pub strings: Vec<String>,
}

impl Descriptors {
    /// A device descriptor of USB 2.0 with one configuration, and strings 1, 2, 3 for maker, product and serial number.
    pub fn device(class: u8, vendor: u16, product: u16) -> Vec<u8> {
        Self::device_of_version(class, vendor, product, 0x0100)
    }

    /// The same with the maker's number for the device's version.
    pub fn device_of_version(class: u8, vendor: u16, product: u16, version: u16) -> Vec<u8> {
        let [version_low, version_high] = version.to_le_bytes();
        let [vendor_low, vendor_high] = vendor.to_le_bytes();
        let [product_low, product_high] = product.to_le_bytes();
        vec![
            18,
            1,
            0x00,
            0x02,
            class,
            0,
            0,
            64,
            vendor_low,
            vendor_high,
            product_low,
            product_high,
            version_low,
            version_high,
            1,
            2,
            3,
            1,
        ]
    }

    /// A configuration of so many interfaces, powered by the bus; `body` is what follows its own nine bytes.
    pub fn configuration(interfaces: u8, body: &[u8]) -> Vec<u8> {
        let [low, high] = ((9 + body.len()) as u16).to_le_bytes();
        let mut bytes = vec![9, 2, low, high, interfaces, 1, 0, 0x80, 50];
        bytes.extend_from_slice(body);
        bytes
    }

    /// An interface without alternatives.
    pub fn interface(number: u8, endpoints: u8, class: u8, subclass: u8, protocol: u8) -> [u8; 9] {
        [9, 4, number, 0, endpoints, class, subclass, protocol, 0]
    }

    /// An endpoint: address with the direction in bit 7; attributes 1 isochronous, 2 bulk, 3 interrupt.
    pub fn endpoint(address: u8, attributes: u8, packet_len: u16, interval: u8) -> [u8; 7] {
        let [low, high] = packet_len.to_le_bytes();
        [7, 5, address, attributes, low, high, interval]
    }

    /// A standard descriptor by type and index.
    pub(crate) fn get(&self, kind: u8, index: u8) -> Option<Vec<u8>> {
        match (kind, index) {
            (1, _) => Some(self.device.clone()),
            (2, _) => Some(self.configuration.clone()),
            // The languages: English (United States).
            (3, 0) => Some(vec![4, 3, 0x09, 0x04]),
            (3, index) => {
                let text = self.strings.get(usize::from(index) - 1)?;
                let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
                let mut bytes = vec![(units.len() + 2) as u8, 3];
                bytes.extend(units);
                Some(bytes)
            }
            _ => None,
        }
    }
}

/// How fast a device is, as `vhci_hcd` numbers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speed {
    /// 12 Mbit/s.
    Full = 2,
    /// 480 Mbit/s.
    High = 3,
}

/// A request to endpoint 0 (USB 2.0, table 9-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Direction, type and recipient.
    pub request_type: u8,
    /// Which request.
    pub request: u8,
    /// Its value.
    pub value: u16,
    /// Its index, often the interface.
    pub index: u16,
    /// How many bytes follow.
    pub length: u16,
}

impl From<[u8; 8]> for Setup {
    fn from(bytes: [u8; 8]) -> Self {
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Self { request_type: bytes[0], request: bytes[1], value: word(2), index: word(4), length: word(6) }
    }
}

/// The device does not know this request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall;
