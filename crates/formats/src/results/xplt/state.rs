//! States of FEBio's plot file: time, whether it converged, and quantities at nodes and elements by the dictionary.

use super::super::run::{Quantity, Step, counted};
use super::blocks::Bytes;
use super::mesh::Mesh;
use crate::error::Diagnostic;

const DICTIONARY_NODES: u32 = 0x0102_3000;
const DICTIONARY_DOMAINS: u32 = 0x0102_4000;
const ITEM: u32 = 0x0102_0001;
const ITEM_TYPE: u32 = 0x0102_0002;
const ITEM_FORMAT: u32 = 0x0102_0003;
const ITEM_NAME: u32 = 0x0102_0004;
const ITEM_SIZE: u32 = 0x0102_0005;
const STATE_HEADER: u32 = 0x0201_0000;
const STATE_TIME: u32 = 0x0201_0002;
const STATE_STATUS: u32 = 0x0201_0003;
const STATE_DATA: u32 = 0x0202_0000;
const VARIABLE: u32 = 0x0202_0001;
const VARIABLE_NUMBER: u32 = 0x0202_0002;
const VARIABLE_DATA: u32 = 0x0202_0003;
const NODE_DATA: u32 = 0x0202_0300;
const ELEMENT_DATA: u32 = 0x0202_0400;
/// Numbers of each type: a scalar, a vector, tensors (symmetric, diagonal, of fourth order, full). Lists say theirs.
const SIZES: [usize; 6] = [1, 3, 6, 3, 21, 9];
/// Largest list at a node or element that is read.
const MAX_LIST: usize = 32;
/// Most nodes of an element.
const MAX_NODES: usize = 27;
/// A quantity that can be at less than one in so many nodes is passed over.
const SPARSE: usize = 16;
/// Numbers that the sections around a quantity take in a domain, as many as those of its smallest element.
const SECTIONS: usize = 8;
/// Lists in compressed states are not longer.
const LONGEST_LIST: usize = 1000;
/// The order of FEBio's symmetric tensors.
const SYMMETRIC: [&str; 6] = ["xx", "yy", "zz", "xy", "yz", "xz"];

/// The number of a domain and its data.
type Region<'a> = (u32, Bytes<'a>);

/// Where the values of a quantity of elements are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// One at each node of the domain, in the order in which its elements name them first.
    Node,
    /// One at each element.
    Element,
    /// One at each node of each element.
    Corner,
}

#[derive(Clone, Debug)]
struct Item {
    name: String,
    size: usize,
    place: Place,
}

/// The quantities that states hold; those that are no fields at nodes or elements are `None`.
#[derive(Debug, Default)]
pub(super) struct Dictionary {
    /// Numbers of all quantities together, surfaces' and others' too, and some for their sections.
    pub(super) numbers: u64,
    nodes: Vec<Option<Item>>,
    elements: Vec<Option<Item>>,
}

impl Dictionary {
    pub(super) fn read(section: Bytes<'_>) -> Result<Self, Diagnostic> {
        let items = |id| -> Result<Vec<Option<Item>>, Diagnostic> {
            let items = section.block(id)?.map_or_else(|| Ok(Vec::new()), Bytes::blocks)?;
            items.into_iter().filter(|item| item.0 == ITEM).map(|item| Item::read(item.1)).collect()
        };
        let mut numbers = 0;
        for (_, list) in section.blocks()? {
            for (_, item) in list.blocks()? {
                let value = |id| Ok(item.block(id)?.and_then(Bytes::first).unwrap_or(0) as usize);
                let list = 3 * value(ITEM_SIZE)?.min(LONGEST_LIST);
                numbers += (SIZES.get(value(ITEM_TYPE)?).map_or(list, |size| *size) + SECTIONS) as u64;
            }
        }
        Ok(Self { numbers, nodes: items(DICTIONARY_NODES)?, elements: items(DICTIONARY_DOMAINS)? })
    }
}

impl Item {
    fn read(block: Bytes<'_>) -> Result<Option<Self>, Diagnostic> {
        let value = |id| Ok(block.block(id)?.and_then(Bytes::first).map(|value| value as usize));
        let (kind, format, list) = (value(ITEM_TYPE)?, value(ITEM_FORMAT)?, value(ITEM_SIZE)?);
        let size = kind.and_then(|kind| match (SIZES.get(kind), list) {
            (Some(size), _) => Some(*size),
            (None, Some(count)) if kind == SIZES.len() && (1..=MAX_LIST).contains(&count) => Some(count),
            _ => None,
        });
        let place = match format {
            Some(0) => Some(Place::Node),
            Some(1) => Some(Place::Element),
            Some(2) => Some(Place::Corner),
            _ => None,
        };
        let name = block.block(ITEM_NAME)?.map(Bytes::text).unwrap_or_default();
        // A name of the user's may stand behind the one of the quantity.
        let name = name.split_once('=').map_or(name.as_str(), |(_, own)| own).to_owned();
        Ok(size.zip(place).map(|(size, place)| Self { name, size, place }))
    }

    fn quantity(&self, values: Vec<f64>) -> Quantity {
        let components =
            if self.size == 6 { SYMMETRIC.map(str::to_owned).to_vec() } else { counted(self.size) };
        Quantity { name: self.name.clone(), components, values }
    }
}

/// A state, or why it is left out.
pub(super) fn read(
    state: Bytes<'_>,
    dictionary: &Dictionary,
    mesh: &Mesh,
    name: &str,
) -> Result<Result<Step, String>, Diagnostic> {
    let (mut time, mut status) = (None, 0);
    if let Some(header) = state.block(STATE_HEADER)? {
        time = header.block(STATE_TIME)?.and_then(|time| time.floats().next()).filter(|t| t.is_finite());
        status = header.block(STATE_STATUS)?.and_then(Bytes::first).unwrap_or(0);
    }
    if status != 0 {
        return Ok(Err(format!("{name}: not converged (status {status})")));
    }
    let mut quantities = Vec::new();
    let data = state.block(STATE_DATA)?;
    let part = |id| data.map_or(Ok(None), |data| data.block(id));
    for (item, regions) in variables(part(NODE_DATA)?, &dictionary.nodes, name)? {
        let values: Vec<f64> = regions.iter().flat_map(|(_, data)| data.floats()).collect();
        check(name, &item.name, mesh.points.len() * item.size, values.len())?;
        quantities.push(item.quantity(values));
    }
    for (item, regions) in variables(part(ELEMENT_DATA)?, &dictionary.elements, name)? {
        quantities.extend(at_nodes(item, &regions, mesh, name)?.map(|values| item.quantity(values)));
    }
    Ok(Ok(Step { name: name.into(), time, quantities }))
}

fn check(step: &str, quantity: &str, expected: usize, found: usize) -> Result<(), Diagnostic> {
    if expected == found {
        return Ok(());
    }
    Err(Diagnostic::new(format!("{step}, quantity {quantity}"), format!("{expected} numbers"), found))
}

/// Quantities with their data by region, those that are not numbers left out.
fn variables<'a, 'b>(
    data: Option<Bytes<'a>>,
    items: &'b [Option<Item>],
    step: &str,
) -> Result<Vec<(&'b Item, Vec<Region<'a>>)>, Diagnostic> {
    let mut found = Vec::new();
    for (id, variable) in data.map_or_else(|| Ok(Vec::new()), Bytes::blocks)? {
        let number = variable.block(VARIABLE_NUMBER)?.and_then(Bytes::first).unwrap_or(0);
        let item = (number as usize).checked_sub(1).and_then(|at| items.get(at));
        let (Some(item), VARIABLE) = (item, id) else {
            let expected = format!("a quantity from 1 to {}, as many as the dictionary has", items.len());
            return Err(Diagnostic::new(step, expected, number));
        };
        if let (Some(item), Some(data)) = (item, variable.block(VARIABLE_DATA)?) {
            found.push((item, data.blocks()?));
        }
    }
    Ok(found)
}

/// Means at the nodes of what is given for elements; NaN at nodes of which no element has a value. `None` where it is given at a
/// few nodes only, which is no field.
fn at_nodes(
    item: &Item,
    regions: &[Region<'_>],
    mesh: &Mesh,
    step: &str,
) -> Result<Option<Vec<f64>>, Diagnostic> {
    let given: usize = regions.iter().map(|(_, data)| data.data.len() / 4 / item.size).sum();
    if given * MAX_NODES * SPARSE < mesh.points.len() {
        return Ok(None);
    }
    let mut sums = vec![0.0; mesh.points.len() * item.size];
    let mut counts = vec![0_u32; mesh.points.len()];
    for (number, data) in regions {
        let domain =
            (*number as usize).checked_sub(1).and_then(|at| mesh.domains.get(at)).ok_or_else(|| {
                let place = format!("{step}, quantity {}", item.name);
                Diagnostic::new(place, format!("domains 1 to {}", mesh.domains.len()), number)
            })?;
        let (members, each) = match item.place {
            Place::Node => (&domain.distinct, 1),
            Place::Corner => (&domain.nodes, 1),
            Place::Element => (&domain.nodes, domain.size),
        };
        let values: Vec<f64> = data.floats().collect();
        check(step, &item.name, members.len() / each * item.size, values.len())?;
        for (at, node) in members.iter().map(|node| *node as usize).enumerate() {
            counts[node] += 1;
            let value = &values[at / each * item.size..][..item.size];
            sums[node * item.size..][..item.size].iter_mut().zip(value).for_each(|(sum, v)| *sum += v);
        }
    }
    let mean = |(at, sum): (usize, f64)| match counts[at / item.size] {
        0 => f64::NAN,
        count => sum / f64::from(count),
    };
    Ok(Some(sums.into_iter().enumerate().map(mean).collect()))
}
