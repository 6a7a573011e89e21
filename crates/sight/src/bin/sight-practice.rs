//! Scratch.
use ds_sight::*;
use std::time::Instant;
fn main() {
    let root = std::env::args().nth(1).unwrap();
    let mut cases: Vec<_> = std::fs::read_dir(&root).unwrap().map(|e| e.unwrap().path()).filter(|p| p.join("meta.json").exists()).collect();
    cases.sort();
    for c in cases {
        let t = Instant::now();
        let case = FrameCase::read(&c).unwrap();
        let t1 = t.elapsed();
        let scene = scene::Scene::new(&case);
        let ages = align::ages(&scene);
        let t2 = t.elapsed();
        let field = align::field(&scene, &ages.best, ages.start);
        let t3 = t.elapsed();
        println!("{} ages {:?} start {:?} read {:?} ages {:?} field {:?}", case.name, ages.best, ages.start, t1, t2 - t1, t3 - t2);
        let h0 = align::geometry(&scene, &field, &vec![]);
        println!("   H0 {:.0} shifts {:.2?}", h0.loss, &h0.shifts[..3]);
        for id in ["mount_pitch", "mount_yaw", "mount_roll", "focal_error", "radial_distortion", "mount_position", "rolling_shutter"] {
            let e = ds_effect::find_frame(id).unwrap();
            if !scene.can_show(e) { continue; }
            let f = align::geometry(&scene, &field, &vec![(e, e.neutral())]);
            print!("   {} {:.0} {:.4?}", id, h0.loss - f.loss, f.effects[0].1);
        }
        println!();
        let mut m = scene::Model::nominal(scene.frames.len());
        m.ages = ages.best.clone();
        m.shifts = h0.shifts.clone();
        let p = scene.placed(&m);
        let l = loss::measure(&scene, &m, &p);
        println!("   loss {:.0} bands {:?}", l.total, (0..4).map(|b| l.band(b) as i64).collect::<Vec<_>>());
        for b in 0..4 {
            let mut v: Vec<f64> = l.cells[b].iter().flatten().filter(|c| c.floor > 0.0).map(|c| c.excess()).collect();
            if v.is_empty() { continue; }
            v.sort_by(f64::total_cmp);
            let q = |x: f64| v[((v.len() - 1) as f64 * x) as usize];
            println!("   band {b} ln(E/F): {:.2} {:.2} {:.2} {:.2} {:.2}", q(0.05), q(0.25), q(0.5), q(0.75), q(0.95));
        }
        println!("   grain {:?}  {:?}", grain::texture(&scene, &scene.full_of(&m, &p.full)), t.elapsed());
    }
}
