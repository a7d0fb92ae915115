//! A room as tables of text.

use node_client::NodeReport;
use proto::CameraStatus;
use setup::ClusterFile;

use super::days_left;
use super::room::NodeSample;

/// The room's nodes and cameras, a line each, and what it lacks as the last line.
pub fn text(file: &ClusterFile, samples: &[NodeSample], lacks: &[String]) -> String {
    let (nodes, cameras) = (file.nodes.len(), file.cameras.len());
    let mut text = format!("room {}: {nodes} nodes, {cameras} cameras, {} frames/s\n\n", file.name, file.fps);
    let titles = ["node", "address", "version", "clock, ms", "certificate", "led by"];
    text += &aligned(&titles, samples.iter().map(of_node));
    text.push('\n');
    let titles = ["camera", "place", "node", "frames/s", "age, ms", "frame", "foreground"];
    text += &aligned(&titles, samples.iter().flat_map(of_cameras));
    text.push('\n');
    text += &match lacks {
        [] => "all is well\n".to_owned(),
        lacks => format!("lacks: {}\n", lacks.join("; ")),
    };
    text
}

fn of_node(sample: &NodeSample) -> Vec<String> {
    let report = match &sample.found {
        Ok(report) => report,
        Err(error) => {
            let empty = [String::from("-"), "-".into(), "-".into()];
            let place = sample.node.place.to_string();
            return [vec![sample.name(), place], empty.to_vec(), vec![format!("does not answer: {error}")]]
                .concat();
        }
    };
    let status = &report.status;
    let led_by = match &status.holder {
        Some(holder) if holder.is_there => {
            format!("{}, term {}, for {:.0} s", holder.name, holder.term, holder.held_s)
        }
        Some(holder) => format!("{}, which is gone", holder.name),
        None => "no coordinator".to_owned(),
    };
    vec![
        sample.name(),
        report.address.to_string(),
        status.node.version.clone(),
        clock(report),
        days_left(status).map_or_else(|| "none".to_owned(), |days| format!("{days} days")),
        led_by,
    ]
}

fn clock(report: &NodeReport) -> String {
    format!("{:+.1} ± {:.1}", 1e3 * report.clock_offset_s, 1e3 * report.clock_bound_s)
}

fn of_cameras(sample: &NodeSample) -> Vec<Vec<String>> {
    let node = sample.name();
    let Ok(NodeReport { status, .. }) = &sample.found else {
        let row = |name: &String, place: u16| {
            let unknown = vec!["-".to_owned(); 4];
            [vec![name.clone(), place.to_string(), node.clone()], unknown].concat()
        };
        return sample.node.cameras.iter().map(|camera| row(&camera.name, camera.rig_index)).collect();
    };
    let named = status.node.cameras.iter().zip(&status.cameras);
    named.map(|(named, camera)| of_camera(&named.name, &node, camera)).collect()
}

fn of_camera(name: &str, node: &str, camera: &CameraStatus) -> Vec<String> {
    let newest = |text: &dyn Fn(&proto::NewestFrame) -> String| {
        camera.newest.as_ref().map_or_else(|| "-".to_owned(), text)
    };
    vec![
        name.to_owned(),
        camera.rig_index.to_string(),
        node.to_owned(),
        format!("{:.1}", camera.frames_per_s),
        newest(&|newest| format!("{:.0}", 1e3 * newest.age_s)),
        newest(&|newest| newest.frame.to_string()),
        newest(&|newest| format!("{:.1} %", 1e2 * newest.foreground)),
    ]
}

/// Columns as wide as what stands in them; the last one may be any length.
fn aligned(titles: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let titles: Vec<String> = titles.iter().map(|title| (*title).to_owned()).collect();
    let rows: Vec<Vec<String>> = std::iter::once(titles).chain(rows).collect();
    let columns = rows[0].len();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default();
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, width)| {
            let blank = " ".repeat(width - cell.chars().count());
            format!("{cell}{blank}")
        });
        format!("{}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_what_stands_in_them() {
        let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
        let rows = [row(["a", "± 1", "x"]), row(["left", "", "a long end"])];
        let expected = "at    clock  why\na     ± 1    x\nleft         a long end\n";
        assert_eq!(aligned(&["at", "clock", "why"], rows.into_iter()), expected);
    }
}
