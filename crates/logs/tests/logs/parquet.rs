use std::sync::Arc;

use bench_logs::Format;
use parquet::{
    data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type},
    file::{properties::WriterProperties, writer::SerializedFileWriter},
    schema::parser::parse_message_type,
};

use crate::{names, read};

/// A table of three columns, of which one may be empty.
pub fn log(rows: u32) -> Vec<u8> {
    let schema = "message log {
        REQUIRED INT64 at (TIMESTAMP(MICROS, true));
        OPTIONAL DOUBLE z;
        REQUIRED BYTE_ARRAY phase (UTF8);
    }";
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let mut bytes = Vec::new();
    let mut writer =
        SerializedFileWriter::new(&mut bytes, schema, Arc::new(WriterProperties::default())).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let times: Vec<i64> = (0..rows).map(|k| i64::from(k) * 10_000).collect();
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<Int64Type>().write_batch(&times, None, None).unwrap();
    column.close().unwrap();
    // Each third cell is empty.
    let levels: Vec<i16> = (0..rows).map(|k| i16::from(k % 3 != 2)).collect();
    let heights: Vec<f64> = (0..rows).filter(|k| k % 3 != 2).map(|k| f64::from(k) * 0.5).collect();
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<DoubleType>().write_batch(&heights, Some(&levels), None).unwrap();
    column.close().unwrap();
    let words = vec![ByteArray::from("hold"); rows as usize];
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<ByteArrayType>().write_batch(&words, None, None).unwrap();
    column.close().unwrap();
    group.close().unwrap();
    writer.close().unwrap();
    bytes
}

#[test]
fn columns_are_the_fields_of_one_topic_without_a_name() {
    let read = read(Format::Parquet, &log(4)).unwrap();
    assert_eq!(names(&read), [""]);
    let cells: Vec<_> = read.samples.iter().map(|sample| sample.cells.join(" ")).collect();
    assert_eq!(cells, ["0 0 hold", "10000000 0.5 hold", "20000000  hold", "30000000 1.5 hold"]);
    assert!(read.samples.iter().all(|sample| sample.time_ns.is_none()));
}

#[test]
fn a_cut_table_says_that_it_cannot_be_read_and_why() {
    let bytes = log(4);
    for end in [4, 40, bytes.len() - 1] {
        let words = read(Format::Parquet, &bytes[..end]).unwrap_err().to_string();
        assert!(words.contains("Parquet") && words.contains("cut"), "{words}");
    }
}
