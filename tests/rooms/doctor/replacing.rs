//! A way to a node over which some bytes of its answers become others of the same length.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

/// A peer that connects to its address reaches the node. Ends with the test.
pub struct Replacing {
    pub address: SocketAddr,
    is_over: Arc<AtomicBool>,
}

impl Replacing {
    /// A way to that address.
    pub fn to(to: SocketAddr, from: &[u8], into: &[u8]) -> Replacing {
        assert_eq!(from.len(), into.len(), "lengths stand before texts");
        let listener = TcpListener::bind(("127.0.0.1", 0)).expect("listens");
        let address = listener.local_addr().expect("bound");
        let (is_over, words) = (Arc::new(AtomicBool::new(false)), (from.to_vec(), into.to_vec()));
        let over = Arc::clone(&is_over);
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if over.load(Ordering::Relaxed) {
                    return;
                }
                // A node that is not there refuses, and so does the way to it.
                let Ok(node) = TcpStream::connect(to) else { continue };
                let (Ok(client_too), Ok(node_too)) = (client.try_clone(), node.try_clone()) else { continue };
                let words = words.clone();
                thread::spawn(move || carry(client, node, &(Vec::new(), Vec::new())));
                thread::spawn(move || carry(node_too, client_too, &words));
            }
        });
        Replacing { address, is_over }
    }
}

impl Drop for Replacing {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        // Wakes the listener.
        let _ = TcpStream::connect(self.address);
    }
}

/// Texts that are cut by the end of a read stay as they are: short answers are not.
fn carry(mut from: TcpStream, mut to: TcpStream, (word, other): &(Vec<u8>, Vec<u8>)) {
    let mut buffer = vec![0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        let bytes = &mut buffer[..count];
        for at in 0..(count + 1).saturating_sub(word.len()) {
            if bytes[at..].starts_with(word) {
                bytes[at..at + word.len()].copy_from_slice(other);
            }
        }
        if to.write_all(bytes).is_err() {
            break;
        }
    }
    // The other side may have closed it.
    let _ = to.shutdown(Shutdown::Both);
}
