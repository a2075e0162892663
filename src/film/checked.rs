//! Bytes with a checksum, for the binary files that are written here: states, photon maps.

use std::io::{self, Read, Write};

/// Passes bytes through and computes their CRC-32.
pub(crate) struct Checked<T> {
    pub(crate) inner: T,
    pub(crate) checksum: crc32fast::Hasher,
}

impl<T> Checked<T> {
    pub(crate) fn new(inner: T) -> Self {
        Self { inner, checksum: crc32fast::Hasher::new() }
    }
}

impl<W: Write> Write for Checked<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.inner.write(bytes)?;
        self.checksum.update(&bytes[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.inner.read(bytes)?;
        self.checksum.update(&bytes[..n]);
        Ok(n)
    }
}

pub(crate) fn read_array<const N: usize>(input: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    input.read_exact(&mut bytes)?;
    Ok(bytes)
}
