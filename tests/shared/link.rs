//! A far network of a test's own: bytes pass through it late, in their order, and may be cut off.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// How late bytes are, one way.
#[derive(Clone, Copy, Debug)]
pub struct Delay {
    /// In the middle, milliseconds.
    pub ms: f64,
    /// And at most so much more or less.
    pub jitter_ms: f64,
}

/// A way to a node: a peer that connects to its address reaches the node. Ends with the test.
pub struct Link {
    pub address: SocketAddr,
    shared: Arc<Shared>,
}

struct Shared {
    to: SocketAddr,
    delay: Mutex<Delay>,
    random: AtomicU64,
    is_cut: AtomicBool,
    is_over: AtomicBool,
    open: Mutex<Vec<TcpStream>>,
}

impl Link {
    /// A way to that address; `seed` decides the jitter.
    pub fn to(to: SocketAddr, delay: Delay, seed: u64) -> Link {
        let listener = TcpListener::bind(("127.0.0.1", 0)).expect("listens");
        let address = listener.local_addr().expect("bound");
        let shared = Arc::new(Shared {
            to,
            delay: Mutex::new(delay),
            random: AtomicU64::new(seed),
            is_cut: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
            open: Mutex::default(),
        });
        let of_listener = Arc::clone(&shared);
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if of_listener.is_over.load(Ordering::Relaxed) {
                    return;
                }
                // A node that is not there refuses, and so does the way to it.
                let _ = of_listener.carry(client);
            }
        });
        Link { address, shared }
    }

    /// From now on bytes are so late.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn set_delay(&self, delay: Delay) {
        *self.shared.delay.lock() = delay;
    }

    /// Cuts it: what is on its way is lost, connections break, none is made; or mends it.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn cut(&self, is_cut: bool) {
        self.shared.is_cut.store(is_cut, Ordering::Relaxed);
        if is_cut {
            self.shared.close();
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        self.shared.close();
        // Wakes the listener.
        let _ = TcpStream::connect(self.address);
    }
}

impl Shared {
    fn carry(self: &Arc<Shared>, client: TcpStream) -> std::io::Result<()> {
        if self.is_cut.load(Ordering::Relaxed) {
            return Ok(());
        }
        let node = TcpStream::connect_timeout(&self.to, Duration::from_secs(2))?;
        client.set_nodelay(true)?;
        node.set_nodelay(true)?;
        let mut open = self.open.lock();
        open.extend([client.try_clone()?, node.try_clone()?]);
        drop(open);
        for (from, to) in [(client.try_clone()?, node.try_clone()?), (node, client)] {
            let (late, written) = channel();
            let shared = Arc::clone(self);
            thread::spawn(move || shared.read(from, &late));
            thread::spawn(move || write(to, &written));
        }
        Ok(())
    }

    fn read(&self, mut from: TcpStream, late: &Sender<(Instant, Vec<u8>)>) {
        let (mut buffer, mut due) = (vec![0; 1 << 16], Instant::now());
        while let Ok(count @ 1..) = from.read(&mut buffer) {
            due = due.max(Instant::now() + self.lateness());
            if late.send((due, buffer[..count].to_vec())).is_err() {
                return;
            }
        }
    }

    fn lateness(&self) -> Duration {
        let Delay { ms, jitter_ms } = *self.delay.lock();
        // SplitMix64.
        let mut mixed = self.random.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = (mixed >> 11) as f64 / (1u64 << 53) as f64;
        Duration::from_secs_f64((ms + jitter_ms * (2.0 * unit - 1.0)).max(0.0) * 1e-3)
    }

    fn close(&self) {
        for stream in self.open.lock().drain(..) {
            // It may be closed.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

fn write(mut to: TcpStream, written: &Receiver<(Instant, Vec<u8>)>) {
    while let Ok((due, bytes)) = written.recv() {
        thread::sleep(due.saturating_duration_since(Instant::now()));
        if to.write_all(&bytes).is_err() {
            break;
        }
    }
    // The other side may have closed it.
    let _ = to.shutdown(Shutdown::Write);
}
