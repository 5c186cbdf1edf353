mod common;
#[test]
fn make() { let d = std::path::Path::new("/tmp/h/prof"); let mut s = common::session();
 let rig = bench_rig::Rig::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/virtual.toml")).unwrap(); s.rig_toml = Some(rig.to_toml());
 let (p, _) = common::write(d, "x.mcap", &s, &common::flight(20.0));
 for n in ["x.csv","x.xlsx","x.parquet"] { println!("{:?}", bench_recording::export(&p, d.join(n), &Default::default())); } 
 bench_recording::export(&p, d.join("p.parquet"), &bench_recording::ExportOptions{channel: Some("/tracker/position".into())}).unwrap(); 
 println!("{}", serde_json::to_string_pretty(&bench_recording::Info::read(&p).unwrap()).unwrap()); }
