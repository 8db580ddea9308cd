"""What a policy says of the robot that it drives, against the robot; the policy in the loop.

A reader for each kind of file (`deploy_yaml`, `isaaclab_yaml`, `mjlab_onnx`) turns it into a
`stated.Policy`; `compare` lays that beside a bundle, `replay` lets it drive, `diagnose` searches
for the wiring fault that makes it fall. The network runs in a process of its own: `network`.
"""
