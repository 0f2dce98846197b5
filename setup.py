"""How hpv_twin is built and installed, by pip and by colcon alike."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'hpv_twin'
SHARE = f'share/{PACKAGE}'

# The wheels of ROS 2 Jazzy exist for x86-64 Linux alone; elsewhere ROS comes from its distribution.
ROS_WHEELS = 'sys_platform == "linux" and platform_machine == "x86_64"'

setup(
    name=PACKAGE,
    version='0.1.0',
    description='Real-time digital twin of a small hydropulse vibrator, for ROS 2 Jazzy',
    author='hpv_twin maintainers',
    author_email='hpv-twin@example.org',
    maintainer='hpv_twin maintainers',
    maintainer_email='hpv-twin@example.org',
    license='Apache-2.0',
    keywords=['ROS', 'digital twin', 'hydraulics', 'vibrator', 'MCAP', 'rerun'],
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    zip_safe=False,
    python_requires='>=3.11,<3.14',
    install_requires=[
        'mcap>=1.5,<2',
        'numba>=0.59,<1',
        'numpy>=1.26,<3',
        'PyYAML>=6,<7',
        'scipy>=1.11,<2',
        'zstandard>=0.18,<1',
    ],
    extras_require={
        'ros': [
            f'ros-jazzy-rclpy[fastrtps]; {ROS_WHEELS}',
            f'ros-jazzy-common-interfaces; {ROS_WHEELS}',
        ],
        'viewer': ['rerun-sdk==0.41.*'],
        # dask is what joblib hands studies to when one machine is too small.
        'study': [
            'dask[distributed]>=2024.1',
            'joblib>=1.4,<2',
            'matplotlib>=3.8',
            'pymoo>=0.6.1,<0.7',
            'tqdm>=4.60,<5',
        ],
        'parquet': ['pyarrow>=14'],
        'test': [
            'colcon-common-extensions',
            'hypothesis',
            'mcap-ros2-support',
            'psutil',
            'pytest',
            'pytest-cov',
            'pytest-timeout',
            'rosbags',
            'ruff',
            'setuptools>=68',
            'wheel',
        ],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (SHARE, ['package.xml']),
        (f'{SHARE}/config', sorted(glob('config/*.yaml'))),
        (f'{SHARE}/config/sros2', sorted(glob('config/sros2/*.xml'))),
        (f'{SHARE}/launch', sorted(glob('launch/*.launch.py'))),
        # One executable per command, where `ros2 run` looks. pip would put no script there.
        (f'lib/{PACKAGE}', sorted(glob('launchers/*'))),
    ],
    entry_points={'console_scripts': [f'hpv-twin = {PACKAGE}.cli:main']},
)
