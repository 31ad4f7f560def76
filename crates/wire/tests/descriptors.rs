//! Exhausted file descriptors are named. A separate program, because the limit applies to the whole process.

use wire::{Bus, Domain, StateWriter, Topic, WireError};

fn limit_files(count: libc::rlim_t) {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid, writable structure; lowering and raising the soft limit breaks nothing that is open.
    unsafe {
        assert_eq!(libc::getrlimit(libc::RLIMIT_NOFILE, &mut limit), 0);
        limit.rlim_cur = count;
        assert_eq!(libc::setrlimit(libc::RLIMIT_NOFILE, &limit), 0);
    }
}

#[test]
fn used_up_descriptors_are_called_so_and_nothing_stays_broken() {
    let domain = Domain::isolated("files");
    let topic = Topic::state("finger").unwrap();
    let open = std::fs::read_dir("/proc/self/fd").unwrap().count() as libc::rlim_t;
    let mut refusals = 0;
    // With a few more at a time, each step of the start once lacks one.
    for more in 0..60 {
        limit_files(open + more);
        let made = Bus::open(&domain).and_then(|bus| Ok((StateWriter::create(&bus, &topic)?, bus)));
        match made {
            Err(WireError::TooManyFiles { limit, .. }) => {
                assert_eq!(limit, open + more);
                refusals += 1;
            }
            Err(other) => panic!("with {more} more: {other}"),
            Ok(_) => break,
        }
    }
    assert!((5..60).contains(&refusals), "{refusals}");
    limit_files(1024);
    let bus = Bus::open(&domain).unwrap();
    StateWriter::create(&bus, &topic).unwrap();
    drop(bus);
    domain.remove_leftovers().unwrap();
}
